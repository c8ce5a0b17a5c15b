"""The lod-meta.json of a streamed SOG scene: in which files the Gaussians of each place are, level by level.

The format, version 1: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog/
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.parsing import parse
from tigas_common.wire.model import Entries
from tigas_render.scenes.sog_meta import MOST_COUNT, PLAIN_NAME

LOD_META = "lod-meta.json"
MAX_LOD_META = 16 << 20
"""Bytes; a leaf of the tree takes some 500."""
MOST_FILES = 4096
"""Of all levels; splat-transform puts half a million Gaussians into each."""


def _checked(name: str) -> str:
    if not all(map(PLAIN_NAME.fullmatch, name.split("/"))):
        raise ValueError(f"{name[:40]!r} is not a plain name of a file in a folder next to it")
    return name


def _without_slash(name: object) -> object:
    return name.removesuffix("/") if isinstance(name, str) else name


Name = Annotated[str, Field(max_length=200), AfterValidator(_checked)]
Level = Annotated[int, Field(ge=0, lt=64)]
"""Of detail; 0 is the finest."""
Index = Annotated[int, Field(ge=0, le=MOST_COUNT)]
"""Of a Gaussian in a file, or how many there are."""


@dataclass(frozen=True, slots=True)
class Run:
    """Gaussians that follow each other in a file."""

    file: int
    """Its place among the names."""
    offset: Index
    count: Index


@dataclass(frozen=True, slots=True)
class Node:
    """A leaf, if it has levels of detail; otherwise its children make it up."""

    children: Entries[Node] = ()
    lods: dict[Level, Run] | None = None


class LodMeta(BaseModel):
    """The content of a lod-meta.json; unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    version: Literal[1] = 1
    """Files from before there were versions have none."""
    filenames: Annotated[Entries[Name], Field(max_length=MOST_FILES)]
    tree: Node
    environment: Annotated[Name, BeforeValidator(_without_slash)] | None = None
    """The environment of the scene, always drawn: a SOG file, its meta.json, or the folder of that."""


def parse_lod_meta(name: str, content: bytes) -> LodMeta:
    """Read a lod-meta.json; `name` is the scene file's, for people. Raises BrokenScene with one sentence."""
    try:
        return parse(LodMeta, content, MAX_LOD_META)
    except InvalidRequest as error:
        raise BrokenScene(f"{name} is not one of streamed SOG, version 1: {error.detail}") from None


def finest(name: str, meta: LodMeta) -> dict[str, list[range]]:
    """Of each file, the Gaussians that are the finest level of a leaf, in their order there.

    Raises BrokenScene with one sentence; `name` is the scene file's.
    """
    chosen: dict[str, list[range]] = {}
    waiting = [meta.tree]
    while waiting:
        node = waiting.pop()
        if node.lods is None:
            waiting.extend(reversed(node.children))
            continue
        levels = [level for level, run in node.lods.items() if run.count]
        if not levels:
            continue
        run = node.lods[min(levels)]
        if not 0 <= run.file < len(meta.filenames):
            raise BrokenScene(f"{name} takes Gaussians from file {run.file}, and names {len(meta.filenames)} files.")
        chosen.setdefault(meta.filenames[run.file], []).append(range(run.offset, run.offset + run.count))
    for file, runs in chosen.items():
        runs.sort(key=lambda run: run.start)
        if any(before.stop > after.start for before, after in pairwise(runs)):
            raise BrokenScene(f"{name} takes some Gaussians of {file} twice.")
    return chosen
