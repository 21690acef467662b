"""Print the columns of a shard as the table in docs/records.md.

python docs/studies/columns.py
"""

from explore_bench.steps import FINAL_COLUMNS, REPLAY_COLUMNS, STEP_COLUMNS


def table() -> str:
    """Columns with type, unit and meaning, as Markdown."""
    lines = ["| column | type | unit | meaning |", "|---|---|---|---|"]
    for name, column in (STEP_COLUMNS | FINAL_COLUMNS | REPLAY_COLUMNS).items():
        lines.append(f"| `{name}` | {column.dtype} | {column.unit} | {column.meaning or '〃'} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table(), end="")
