"""What is said of foreign names, values and errors: one line, however long or broken they are."""

from __future__ import annotations

MOST = 1000
"""Characters of a sentence; of a longer one the middle is left out."""


def one_line(text: str, most: int = MOST) -> str:
    """Text without line breaks and other control characters, shortened to `most` characters."""
    if len(text) > 4 * most:  # before anything is done with all of it
        text = f"{text[: 2 * most]} … {text[-2 * most :]}"
    line = " ".join("".join(character if character.isprintable() else " " for character in text).split())
    half = (most - 3) // 2
    return line if len(line) <= most else f"{line[:half]} … {line[-half:]}"
