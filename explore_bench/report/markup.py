"""How a Table is laid out in HTML: grouped headings, aligned columns, and what a filter needs to know."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from markupsafe import Markup

from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import Scope, Table

NOTHING = Markup("")

LONG_TEXT = 40
"""Characters from which on the cells of a column may wrap."""


def row_scope(scope: Scope, numbers: dict[str, int]) -> Markup:
    """Attributes that say which strategies, by number ("none" for one that never ran), and size a row speaks of."""
    if not scope.strategies:
        return size_attribute(scope)
    own = " ".join(str(numbers.get(name, "none")) for name in scope.strategies)
    return Markup(' data-s="{}"{}').format(own, size_attribute(scope))


@dataclass(frozen=True)
class HeaderGroup:
    """Heading over columns that speak of one size: title and names of the columns; none where it is itself one."""

    title: str
    names: tuple[str, ...] = ()
    attributes: Markup = NOTHING
    plain: Markup = NOTHING


def header_groups(table: Table) -> list[HeaderGroup]:
    """Headings of a table; of columns that speak of one size, "group: first" and those after it become a group."""
    groups: list[HeaderGroup] = []
    for i, name in enumerate(table.header):
        scope = table.columns[i] if table.columns else Scope()
        title, colon, first = name.rpartition(": ")
        if scope.size is None:
            groups.append(HeaderGroup(name, attributes=Markup(_alignment(table, i))))
        elif colon:
            plain = size_attribute(scope)
            groups.append(HeaderGroup(title, (first,), Markup(' class="edge"') + plain, plain))
        else:
            groups[-1] = replace(groups[-1], names=(*groups[-1].names, name))
    return groups


def column_attributes(table: Table) -> list[Markup]:
    """Attributes of the cells of each column."""
    if not table.columns:
        return [Markup(_alignment(table, i)) for i in range(len(table.header))]
    edges = [' class="edge"' if ": " in name else "" for name in table.header]
    return [Markup(edge) + size_attribute(scope) for edge, scope in zip(edges, table.columns, strict=True)]


def _alignment(table: Table, column: int) -> str:
    """Class of a column of words, which are aligned on the left; none for one of numbers."""
    own = [row[column] for row in table.rows]
    if all(re.match(r"[−\d–]|not ", text) for text in own) and not any(re.search(r"[a-z]{3}\d", text) for text in own):
        return ""
    return ' class="long"' if max(map(len, own)) > LONG_TEXT else ' class="words"'


def dot(table: Table, row: Sequence[str]) -> Markup:
    """Colour of the strategy that a row is named after."""
    scope = table.scopes[table.rows.index(tuple(row))] if table.scopes else Scope()
    if len(scope.strategies) != 1:
        return NOTHING
    return Markup('<span class="dot" style="--c:{}"></span>').format(entry_of(scope.strategies[0]).color)


def size_attribute(scope: Scope) -> Markup:
    """Attribute that says of which size a row or a cell speaks."""
    return NOTHING if scope.size is None else Markup(' data-z="{}"').format(f"{scope.size:g}")
