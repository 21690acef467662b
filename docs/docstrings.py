"""Docstrings for the site: after "name :" they say what a thing is, where numpy's would say its type.

Types are in the code; mkdocstrings takes them from there, once what stands after the colon lies in a line of its own.
"""

import re

import griffe

_SECTION = re.compile(r"(?ms)^(?:Attributes|Parameters|Raises|Returns|Yields)\n-+\n.*?(?=^\S[^\n]*\n-{3,}\n|\Z)")
_ITEM = re.compile(r"(?m)^(\S.*?) : (.*)$")


class Descriptions(griffe.Extension):
    """Puts what a docstring says of each item into a line of its own."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Change the docstring of an object before it is read."""
        if obj.docstring:
            obj.docstring.value = described(obj.docstring.value)


def described(docstring: str) -> str:
    """Docstring with what follows a name and a colon below the name, indented, in every section of items."""
    return _SECTION.sub(lambda section: _ITEM.sub(r"\1\n    \2", section[0]), docstring)
