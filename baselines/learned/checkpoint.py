"""Weights as safetensors, each with a card beside it that says what they are and how they were made."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from explore_bench import RequestError, parse_json, read_text, writing

FORMAT = 1

FORMERLY = {"GraphSTNNPlus": "BeliefAttention"}
"""Classes of networks by the names that they have on older cards."""


def describe(network: nn.Module) -> dict[str, Any]:
    """What must agree between a network and a card: its class, its switches and its feature columns."""
    return {
        "format": FORMAT,
        "network": type(network).__name__,
        "switches": dict(network.switches),  # type: ignore[arg-type]
        "columns": list(network.columns),  # type: ignore[arg-type]
        "parameter_count": sum(parameter.numel() for parameter in network.parameters()),
    }


def save_weights(network: nn.Module, path: Path, facts: Mapping[str, Any]) -> None:
    """Write a network's weights to `path` and its card, `describe` and `facts`, beside it, each atomically.

    The card holds the digest of the weights, so that a pair that does not belong together is refused.

    Raises
    ------
    RequestError : when the folder cannot be written, or the disk is full.
    """
    save_tensors(path, {name: tensor.detach() for name, tensor in network.state_dict().items()})
    save_json(path.with_suffix(".json"), {**describe(network), "sha256": _digest(path), **facts})


def load_weights(network: nn.Module, path: str | Path) -> dict[str, Any]:
    """Put stored weights into a network of the same kind and return their card.

    Raises
    ------
    RequestError : when the weights or their card are missing, damaged, no pair, or made for another network.
    """
    path = Path(path)
    tensors = load_tensors(path)
    card = read_card(path)
    for key, wanted in describe(network).items():
        if FORMERLY.get(str(card.get(key)), card.get(key)) != wanted:
            raise RequestError(
                f"weights '{path.name}' were made for {key} {card.get(key)!r}, not {wanted!r}; "
                "train them anew with 'explore-bench train'."
            )
    expected = {name: _shape(tensor) for name, tensor in network.state_dict().items()}
    found = {name: _shape(tensor) for name, tensor in tensors.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            raise RequestError(
                f"weights '{path.name}' hold '{name}' as {found.get(name, 'nothing')}, the network wants "
                f"{expected.get(name, 'nothing')}; train them anew with 'explore-bench train'."
            )
        if not tensors[name].isfinite().all():
            raise RequestError(f"weights '{path.name}' hold numbers in '{name}' that are not finite; train them anew.")
    if card.get("sha256") != _digest(path):
        raise RequestError(
            f"weights '{path.name}' are not those of their card '{path.with_suffix('.json').name}'; restore both, or "
            "train them anew with 'explore-bench train'."
        )
    network.load_state_dict(tensors)
    return card


def _shape(tensor: Tensor) -> str:
    return f"{tuple(tensor.shape)} of {str(tensor.dtype).removeprefix('torch.')}"


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_card(path: Path) -> dict[str, Any]:
    """Card of the weights at `path`.

    Raises
    ------
    RequestError : when it is missing or damaged.
    """
    return load_json(path.with_suffix(".json"))


def save_tensors(path: Path, tensors: Mapping[str, Tensor], metadata: dict[str, str] | None = None) -> None:
    """Write named tensors atomically."""
    with _replacing(path) as half:
        try:
            save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, half, metadata)
        except SafetensorError as error:
            raise OSError(errno.EIO, str(error)) from None


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """File to write beside `path`, which takes its place once it is whole and is removed where it is not."""
    half = path.with_name(f"{path.name}.{os.getpid()}.part")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield half
            half.replace(path)
        finally:
            half.unlink(missing_ok=True)


def load_tensors(path: Path) -> dict[str, Tensor]:
    """Read named tensors.

    Raises
    ------
    RequestError : when the file is missing, truncated or no safetensors file.
    """
    if not path.is_file():
        raise RequestError(f"there are no weights '{path}'; make them with 'explore-bench train'.")
    try:
        return load_file(path)
    except (SafetensorError, OSError) as error:
        raise RequestError(f"weights '{path}' cannot be read ({error}); restore or train them anew.") from None


def save_state(path: Path, tensors: Mapping[str, Tensor], facts: Mapping[str, Any]) -> None:
    """Write the state of a training as one file: tensors, and plain values as its metadata, atomically."""
    save_tensors(path, tensors, {"facts": json.dumps(facts)})


def load_state(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read what `save_state` wrote.

    Raises
    ------
    RequestError : when the file is missing, truncated or something else.
    """
    tensors = load_tensors(path)
    with safe_open(path, framework="pt") as file:
        text = (file.metadata() or {}).get("facts", "")
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError):
        facts = None
    if not isinstance(facts, dict):
        raise RequestError(f"'{path}' is no checkpoint of a training; remove it and train without --resume.")
    return tensors, facts


def save_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write plain values atomically."""
    with _replacing(path) as half:
        half.write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def load_json(path: Path) -> dict[str, Any]:
    """Read what `save_json` wrote.

    Raises
    ------
    RequestError : when the file is missing, damaged or beyond the limits of files of others.
    """
    try:
        values = parse_json(read_text(path))
    except (OSError, ValueError) as error:
        raise RequestError(f"'{path}' cannot be read ({error}); restore it or train anew.") from None
    if not isinstance(values, dict):
        raise RequestError(f"'{path}' is no card of weights; restore it or train anew.")
    return values
