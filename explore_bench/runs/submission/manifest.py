"""What a submission says of itself: the fields of its submission.json; `submissions/schema.json` is their schema."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from explore_bench.errors import RequestError, one_line
from explore_bench.files import parse_json

FORMAT: Literal[1] = 1
"""Version of the format of a submission."""

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Word = Annotated[str, Field(min_length=1, max_length=500)]


class Weights(BaseModel):
    """Weights of one training seed.

    Attributes
    ----------
    seed : training seed.
    file : in the submission, or "package:path" of an installed package.
    digest : SHA-256 of the file.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(ge=0)
    file: Word
    digest: Digest


class Manifest(BaseModel):
    """A submission.

    Attributes
    ----------
    format : version of this format.
    suite, root : suite that it ran, and root seed of its worlds.
    strategy : name under which its trials are kept, with its parameters.
    factory : what makes it: "source/FILE.py:NAME" of a file in the submission, or "module:name" of a package.
    version, record_version : of explore-bench and of its records.
    code : digest of all source that defines its trials.
    libraries : versions of the libraries that define them.
    source : SHA-256 of each file of source in the submission.
    weights : of a learned strategy, a training seed each.
    trials : number of its trials.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, title="Submission to explore-bench")

    format: Literal[1] = FORMAT
    suite: Word
    root: int = Field(default=0, ge=0)
    strategy: Word
    factory: Word
    version: Word
    record_version: int = Field(ge=1)
    code: Digest
    libraries: dict[Word, Word]
    source: dict[Word, Digest]
    weights: tuple[Weights, ...]
    trials: int = Field(ge=1)


def schema() -> dict[str, Any]:
    """JSON schema of a manifest."""
    return Manifest.model_json_schema()


def parse_manifest(text: str) -> Manifest:
    """Manifest of a text in JSON.

    Raises
    ------
    RequestError : where it is none.
    """
    try:
        return Manifest.model_validate(parse_json(text))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"])) or "it"
        more = f", and {error.error_count() - 1} more" if error.error_count() > 1 else ""
        raise RequestError(
            f"submission.json is not of the schema: {one_line(place, 100)}: {one_line(first['msg'], 200)}{more}; "
            "pack it with 'explore-bench submit'."
        ) from None
    except ValueError as error:
        raise RequestError(f"submission.json cannot be read: {error}.") from None
