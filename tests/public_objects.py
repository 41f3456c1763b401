"""Every public function, class and method, found from the name mapping and from what public modules offer."""

import importlib
import inspect

import hexakin as hk


def public_objects():
    """Functions, classes and their own methods by their full names, in alphabetical order."""
    found = {}
    for place in hk.PUBLIC.values():
        module_name, _, attribute = place.partition(":")
        module = importlib.import_module(module_name)
        for name in [attribute] if attribute else names_of(module):
            value = getattr(module, name)
            if _is_ours(value):
                found[f"{value.__module__}.{value.__qualname__}"] = value
                if inspect.isclass(value):
                    for method, of in inspect.getmembers(value, _is_ours):
                        if not method.startswith("_") and getattr(of, "__name__", "") == method:
                            found[f"{value.__module__}.{value.__qualname__}.{method}"] = of
    return dict(sorted(found.items()))


def names_of(module):
    """The public names of a module: its ``__all__``, or else what it defines itself."""
    own = [n for n, v in vars(module).items() if not n.startswith("_") and _defined_in(v) == module.__name__]
    return getattr(module, "__all__", own)


def _defined_in(value):
    return getattr(value, "__module__", "") or ""


def _is_ours(value):
    routine = inspect.ismethod(value) or inspect.isfunction(inspect.unwrap(value)) if callable(value) else False
    return (routine or inspect.isclass(value)) and _defined_in(value).startswith("hexakin")
