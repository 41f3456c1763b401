"""Make the calls that ``__main__`` asks for, one line of JSON each, and answer with their outcomes."""

import contextlib
import io
import json
import os
import resource
import sys
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

MEMORY = 12 * 2**30  # [bytes] A call that takes more ends with MemoryError.


def main():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    answers, questions = os.fdopen(os.dup(1), "w"), sys.stdin
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the engines print in C
    os.dup2(1, 2)
    import examples

    os.chdir(examples.folder())
    for line in questions:
        question = json.loads(line)
        if question is None:
            answer = ["ready"]
        elif question == "calls":
            answer = all_calls()
        else:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                answer = outcome(*question)
        print(json.dumps(answer), file=answers, flush=True)


def all_calls():
    """Every call: the callable's name, its argument, and the name of the wrong value."""
    import examples
    import values

    calls = []
    for name in names():
        _, makers = examples.call_of(name)
        for parameter in examples.parameters_of(name):
            own = [kind for kind, _ in values.derived(makers[parameter]())] if parameter in makers else []
            kinds = [kind for kind in (*values.GENERAL, *own) if not examples.is_long(name, parameter, kind)]
            calls += [[name, parameter, kind] for kind in kinds]
    return calls


def names():
    """The public callables with arguments; errors and abstract classes are not called."""
    import inspect

    import examples

    objects = examples.OBJECTS.items()
    errors = [n for n, o in objects if inspect.isclass(o) and issubclass(o, BaseException)]
    protocols = [n for n, o in objects if o in examples.PROTOCOLS or inspect.isabstract(o)]
    return [name for name in examples.OBJECTS if name not in (*errors, *protocols)]


def outcome(name, parameter, kind):
    """Call ``name`` with the wrong value ``kind`` of one argument; return what comes out, and a text."""
    import examples
    import values

    from hexakin.exceptions import HexakinError

    call, makers = examples.call_of(name)
    if kind in values.GENERAL:
        wrong = values.GENERAL[kind]()
    else:
        wrong = dict(values.derived(makers[parameter]()))[kind]
    arguments = {key: make() for key, make in makers.items() if key != parameter} | {parameter: wrong}
    try:
        result = call(**arguments)
        return "result", text_of(result)
    except HexakinError as error:
        return "error", f"{type(error).__name__}: {error}"[:200]
    except TypeError as error:
        depth = len(traceback.extract_tb(error.__traceback__))
        said = f"{error}"[:200]
        return ("refused by Python", said) if depth == 1 else ("raw error", place(error) + said)
    except Exception as error:
        return "raw error", f"{place(error)}{type(error).__name__}: {error}"[:300]


def place(error):
    frames = traceback.extract_tb(error.__traceback__)[1:]
    own = [f for f in frames if "hexakin" in f.filename] or frames
    return f"{own[-1].filename.partition('hexakin/')[2] or own[-1].filename}:{own[-1].lineno}: " if own else ""


def text_of(result):
    try:
        return " ".join(repr(result).split())[:80]
    except Exception as error:
        return f"not shown: {type(error).__name__}"


if __name__ == "__main__":
    main()
