"""Command line: ``python -m hexakin``, or ``hexakin``.

``python -m hexakin study NAME`` runs a study, or continues a study that was interrupted.
``python -m hexakin robot FILE`` checks a robot file and prints a summary of the robot; ``--schema`` prints all fields.
``python -m hexakin statements`` prints every statement of paper A beside the finding of the committed results.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hexakin.exceptions import HexakinError, MissingPackageError, StudyError, UnknownNameError, exit_code, shown
from hexakin.installation import __version__

if TYPE_CHECKING:
    from hexakin.study.runner import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    ``arguments`` are the words of the command line; None takes those of the running program. The exit code is 0, 1
    after an error, 2 for wrong arguments, or 130 after an interrupt.
    """
    return exit_code(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    program = "hexakin" if Path(sys.argv[0]).stem == "hexakin" else "python -m hexakin"
    parser = argparse.ArgumentParser(prog=program, description=__doc__)
    parser.add_argument("--version", action="version", version=f"hexakin {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    study = commands.add_parser("study", help="run a study, or continue one", description=_STUDY)
    study.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="a study of paper A, all, or MODULE:STUDY; without a name they are listed",
    )
    study.add_argument("--folder", default="results", help="folder of the results (default: %(default)s)")
    study.add_argument("--jobs", type=int, help="number of processes (default: one per core)")
    study.add_argument("--restart", action="store_true", help="rename earlier results and start again")
    study.add_argument("--quiet", action="store_true", help="show no progress")
    robot = commands.add_parser("robot", help="check a robot file and print a summary", description=_ROBOT)
    robot.add_argument(
        "file",
        nargs="?",
        metavar="FILE",
        help="a YAML file, or the name of a shipped robot; without it the names are listed",
    )
    robot.add_argument("--schema", action="store_true", help="print every field of a robot file, and an example")
    commands.add_parser("statements", help="print paper A's statements beside our findings, as in the README")
    options = parser.parse_args(arguments)
    return {"study": _study, "robot": _robot, "statements": _statements}[options.command](options)


_STUDY = """Make the runs of a study that are missing in the folder, on all cores. A study can be interrupted and
continued at any time. NAME is one of paper A's studies, "all" for all of them, or MODULE:STUDY: a hexakin.study.Study
(or a function that returns one) in a module that can be imported."""


def _study(options: argparse.Namespace) -> int:
    from hexakin import study
    from hexakin.papers import studies
    from hexakin.study.journal import KEPT

    if not options.names:
        for name, make in studies.STUDIES.items():
            try:
                print(f"{name:16} {len(make()):5d} runs")
            except MissingPackageError as error:
                print(f"{name:16} {error}")
        return 0
    names = [known for name in options.names for known in (studies.STUDIES if name == "all" else [name])]
    for name in names:
        if name not in studies.STUDIES and ":" not in name:
            raise UnknownNameError("study", name, [*studies.STUDIES, "all", "MODULE:STUDY"])
    for chosen in [studies.STUDIES[name]() if name in studies.STUDIES else _imported(name) for name in names]:
        try:
            table = study.run(
                chosen, options.folder, jobs=options.jobs, progress=not options.quiet, restart=options.restart
            )
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(KEPT) from error
        failed = int((table["status"] != "ok").sum())
        print(f"{chosen.name}: {len(table)} runs, {failed} failed: {options.folder}/{chosen.name}.csv")
    return 0


_ROBOT = """Check a robot file. An error names the field, its value and the expected values (exit code 1). For a valid
robot (exit code 0) a summary is printed: masses, inertias, reach, standing pose, limits, and remarks on unusual values.
--schema prints the documentation of the file."""


def _robot(options: argparse.Namespace) -> int:
    from hexakin.robot.file import load_robot, robot_names

    if options.schema:
        from hexakin.robot.schema_page import page

        print(page(), end="")
    elif options.file is None:
        print(*robot_names(), sep="\n")
    else:
        robot = load_robot(options.file)
        from hexakin.robot_summary import summarise

        print(summarise(robot), end="")
    return 0


def _statements(_: argparse.Namespace) -> int:
    from hexakin.papers import results

    print(results.statements_table(), end="")
    return 0


def _imported(name: str) -> Study:
    """Import and return the study that ``name`` (MODULE:STUDY) stands for."""
    from hexakin.study.runner import Study, fault

    module_name, _, attribute = name.partition(":")
    doing = f"importing {module_name}"
    try:
        module = importlib.import_module(module_name)
        found = getattr(module, attribute, None)
        if callable(found):
            doing = f"calling {attribute}"
            found = found()
    except HexakinError:
        raise
    except Exception as error:  # whatever the user's module raises
        raise StudyError(f"study {name}: {doing} failed: {fault(error)}") from error
    if found is None:
        known = [f"{module_name}:{other}" for other, value in vars(module).items() if isinstance(value, Study)]
        raise UnknownNameError("study", name, known or [f"none in {module_name}"])
    if not isinstance(found, Study):
        raise StudyError(
            f"study {name}: expected a hexakin.study.Study or a function returning one, got {shown(found)}"
        )
    return found


if __name__ == "__main__":
    sys.exit(main())
