"""Command line.

``python -m hexakin study NAME`` makes a study, or goes on with one that was interrupted.
``python -m hexakin robot FILE`` checks a robot's file and says what follows from it; ``--schema`` prints its fields.
``python -m hexakin statements`` prints every statement of paper A beside what the committed results say.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hexakin.exceptions import HexakinError, StudyError, UnknownNameError

if TYPE_CHECKING:
    from hexakin.study.runner import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0, 1 after an error, 2 for a wrong call, or 130 when interrupted."""
    parser = argparse.ArgumentParser(prog="python -m hexakin", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    study = commands.add_parser("study", help="make a study, or go on with one", description=_STUDY)
    study.add_argument(
        "names", nargs="*", metavar="NAME", help="a study of paper A, all, or MODULE:STUDY; none lists them"
    )
    study.add_argument("--folder", default="results", help="where the results are kept (default: %(default)s)")
    study.add_argument("--jobs", type=int, help="processes (default: one for each core)")
    study.add_argument("--restart", action="store_true", help="set earlier results aside and begin anew")
    study.add_argument("--quiet", action="store_true", help="show no progress")
    robot = commands.add_parser("robot", help="check a robot's file and sum it up", description=_ROBOT)
    robot.add_argument(
        "file", nargs="?", metavar="FILE", help="a YAML file, or a shipped robot's name; none lists them"
    )
    robot.add_argument("--schema", action="store_true", help="print every field of a robot's file, and an example")
    commands.add_parser("statements", help="print paper A's statements beside what was found, as in the README")
    options = parser.parse_args(arguments)
    try:
        return {"study": _study, "robot": _robot, "statements": _statements}[options.command](options)
    except HexakinError as error:
        print(f"hexakin: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        said = "interrupted; what was finished is kept, and the same call goes on from there"
        print(f"\nhexakin: {said}", file=sys.stderr)
        return 130


_STUDY = """Make the runs of a study that are not in the folder yet, on all cores. It can be interrupted and called
again at any time. NAME is one of paper A's studies, "all" for every one of them, or MODULE:STUDY, a
hexakin.study.Study (or a function that returns one) in a module that can be imported."""


def _study(options: argparse.Namespace) -> int:
    from hexakin import study
    from hexakin.papers import studies

    if not options.names:
        for name, make in studies.STUDIES.items():
            print(f"{name:16} {len(make()):5d} runs")
        return 0
    names = [known for name in options.names for known in (studies.STUDIES if name == "all" else [name])]
    for name in names:
        if name not in studies.STUDIES and ":" not in name:
            raise UnknownNameError("study", name, [*studies.STUDIES, "all", "MODULE:STUDY"])
    for chosen in [studies.STUDIES[name]() if name in studies.STUDIES else _imported(name) for name in names]:
        table = study.run(
            chosen, options.folder, jobs=options.jobs, progress=not options.quiet, restart=options.restart
        )
        failed = int((table["status"] != "ok").sum())
        print(f"{chosen.name}: {len(table)} runs, {failed} failed: {options.folder}/{chosen.name}.csv")
    return 0


_ROBOT = """Check a robot's file: an error names the field, its value and what was expected (exit code 1). Of a robot
that is possible (0) a summary is printed: masses, inertias, reach, standing pose, limits, remarks on what is unusual.
--schema documents the file."""


def _robot(options: argparse.Namespace) -> int:
    from hexakin.robot.file import load_robot, robot_names

    if options.schema:
        from hexakin.robot.schema_page import page

        print(page(), end="")
    elif options.file is None:
        print(*robot_names(), sep="\n")
    else:
        robot = load_robot(options.file)
        from hexakin.robot_summary import summary

        print(summary(robot), end="")
    return 0


def _statements(_: argparse.Namespace) -> int:
    from hexakin.papers import results

    print(results.statements_table(), end="")
    return 0


def _imported(name: str) -> Study:
    """The study that MODULE:STUDY names."""
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
        raise StudyError(f"study {name}: expected a hexakin.study.Study or a function returning one, got {found!r:.80}")
    return found


if __name__ == "__main__":
    sys.exit(main())
