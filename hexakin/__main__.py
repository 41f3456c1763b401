"""Command line: ``python -m hexakin study NAME`` makes a study, or goes on with one that was interrupted."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hexakin.exceptions import HexakinError, UnknownNameError

if TYPE_CHECKING:
    from hexakin.study import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0, 1 after an error, 2 for a wrong call, or 130 when interrupted."""
    parser = argparse.ArgumentParser(prog="python -m hexakin", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    study = commands.add_parser("study", help="make a study, or go on with one", description=_STUDY)
    study.add_argument("names", nargs="*", metavar="NAME", help="a study of paper A, or MODULE:STUDY; none lists them")
    study.add_argument("--folder", default="results", help="where the results are kept (default: %(default)s)")
    study.add_argument("--jobs", type=int, help="processes (default: one for each core)")
    study.add_argument("--restart", action="store_true", help="set earlier results aside and begin anew")
    study.add_argument("--quiet", action="store_true", help="show no progress")
    options = parser.parse_args(arguments)
    try:
        return _study(options)
    except HexakinError as error:
        print(f"hexakin: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        said = "interrupted; what was finished is kept, and the same call goes on from there"
        print(f"\nhexakin: {said}", file=sys.stderr)
        return 130


_STUDY = """Make the runs of a study that are not in the folder yet, on all cores. It can be interrupted and called
again at any time. NAME is one of paper A's studies, or MODULE:STUDY, a hexakin.study.Study (or a function that
returns one) in a module that can be imported."""


def _study(options: argparse.Namespace) -> int:
    from hexakin import studies, study

    if not options.names:
        for name, make in studies.STUDIES.items():
            print(f"{name:16} {len(make()):5d} runs")
        return 0
    for name in options.names:
        if name not in studies.STUDIES and ":" not in name:
            raise UnknownNameError("study", name, [*studies.STUDIES, "MODULE:STUDY"])
    for name in options.names:
        chosen = studies.STUDIES[name]() if name in studies.STUDIES else _imported(name)
        table = study.run(
            chosen, options.folder, jobs=options.jobs, progress=not options.quiet, restart=options.restart
        )
        failed = int((table["status"] != "ok").sum())
        print(f"{chosen.name}: {len(table)} runs, {failed} failed: {options.folder}/{chosen.name}.csv")
    return 0


def _imported(name: str) -> Study:
    from hexakin.study import Study

    module, _, attribute = name.partition(":")
    sys.path.insert(0, "")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UnknownNameError("study", name, [str(error)]) from error
    found = found() if callable(found) else found
    if not isinstance(found, Study):
        raise UnknownNameError("study", name, [f"expected a hexakin.study.Study, got {found!r:.80}"])
    return found


if __name__ == "__main__":
    sys.exit(main())
