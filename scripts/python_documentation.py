"""Checks the documentation of every public name of the Python package by numpydoc's rules."""

import importlib
import inspect
import sys

from numpydoc.validate import validate

MODULES = (
    "sonoweave",
    "sonoweave.archive",
    "sonoweave.batch",
    "sonoweave.dask",
    "sonoweave.errors",
    "sonoweave.live",
    "sonoweave.bridges",
    "sonoweave.plotting",
    "sonoweave.zarr",
)
#: Rules that hold nowhere here: summaries may end without "See also" and examples, classes document
#: their parameters once, and shapes are part of the types.
LEFT_OUT = {
    "ES01",
    "EX01",
    "SA01",
    "GL01",
    "GL02",
    "GL03",
    "PR06",
    "PR08",
    "PR09",
    "RT03",
    "RT05",
    "SS06",
    "YD01",
}


def names():
    """Yield every public function, class and method by its place."""
    for module in MODULES:
        content = importlib.import_module(module)
        for name in content.__all__:
            thing = getattr(content, name)
            if not (inspect.isclass(thing) or inspect.isfunction(thing)):
                continue
            yield f"{module}.{name}"
            if inspect.isclass(thing):
                for member, value in vars(thing).items():
                    if not member.startswith("_") and (
                        callable(value) or isinstance(value, (property, classmethod))
                    ):
                        yield f"{module}.{name}.{member}"


findings = [
    f"{place}: {code} {text}"
    for place in names()
    for code, text in validate(place)["errors"]
    if code not in LEFT_OUT
]
print("\n".join(findings) or f"the documentation of {len(list(names()))} names is complete")
sys.exit(1 if findings else 0)
