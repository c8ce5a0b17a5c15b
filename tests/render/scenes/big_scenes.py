"""Large made-up scenes of any format, and the memory needed to load one."""

from __future__ import annotations

import gzip
import io
import json
import math
import multiprocessing
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from PIL import Image

from tigas_render.local_files import cache_directory
from tigas_render.raster.devices import create_rasterizer
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.ply import REQUIRED, ply_header, rest_names

BLOCK = 1 << 16
WARM_UP = 1000
"""Gaussians of a scene that is loaded before anything is measured, so that kernels are compiled."""


def loaded_in_a_process(folder: Path, format: str, count: int, degree: int) -> tuple[int, int]:
    """Bytes of a made-up scene once packed, and the peak while it is loaded, relative to the process before."""
    small, path = folder / "small.ply", folder / f"hills.{format}"
    write_ply(small, WARM_UP, degree)
    WRITERS[format](path, count, degree)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_load, (small, path))


def _load(small: Path, path: Path) -> tuple[int, int]:
    rasterizer = create_rasterizer("cpu", cache_directory())
    rasterizer.pack(read_scene_file(small).open(lambda _: None))
    before = psutil.Process().memory_info().rss
    scene = rasterizer.pack(read_scene_file(path).open(lambda _: None))
    return scene.nbytes, _peak() - before


def _peak() -> int:
    """For this program: getrusage would include its parent process."""
    found = re.search(r"^VmHWM:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert found is not None
    return 1024 * int(found[1])


def hills(start: int, stop: int, count: int, degree: int) -> dict[str, NDArray[np.float32]]:
    """Some rows of the scene: discs on hills, unordered."""
    random = np.random.default_rng(start)
    number = stop - start
    x, z = random.uniform(-50, 50, (2, number))
    y = 2 * np.sin(x / 7) * np.cos(z / 9) + random.normal(0, 0.05, number)
    size = 100 / np.sqrt(count)
    columns = {
        "means": np.column_stack((x, y, z)),
        "sh": random.normal(0, 0.2, (number, (degree + 1) ** 2, 3)),
        "opacity": random.normal(1, 1, (number, 1)),
        "scales": np.log(size) + random.normal(0, 0.3, (number, 3)),
        "rotation": random.normal(0, 1, (number, 4)),
    }
    return {name: column.astype(np.float32) for name, column in columns.items()}


def write_ply(path: Path, count: int, degree: int) -> None:
    names = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *rest_names(degree), *REQUIRED[6:])
    with path.open("wb") as file:
        file.write(ply_header([("vertex", count, "float", names)]))
        for start in range(0, count, BLOCK):
            rows = hills(start, min(count, start + BLOCK), count, degree)
            rest = rows["sh"][:, 1:].transpose(0, 2, 1).reshape(len(rows["sh"]), -1)
            parts = (rows["means"], rows["sh"][:, 0], rest, rows["opacity"], rows["scales"], rows["rotation"])
            file.write(np.concatenate(parts, axis=1).tobytes())


def write_spz(path: Path, count: int, degree: int) -> None:
    """Version 2."""
    columns: tuple[Callable[[dict[str, NDArray[np.float32]]], NDArray[Any]], ...] = (
        lambda rows: np.rint(rows["means"] * 4096).astype("<i4").view("u1").reshape(-1, 3, 4)[..., :3],
        lambda rows: 255 / (1 + np.exp(-rows["opacity"])),
        lambda rows: (rows["sh"][:, 0] * 0.15 + 0.5) * 255,
        lambda rows: (rows["scales"] + 10) * 16,
        lambda rows: rows["rotation"][:, 1:] / np.linalg.norm(rows["rotation"], axis=1, keepdims=True) * 127.5 + 127.5,
        lambda rows: rows["sh"][:, 1:] * 128 + 128,
    )
    with gzip.open(path, "wb", 1) as file:
        file.write(struct.pack("<4sIIBBBB", b"NGSP", 2, count, degree, 12, 0, 0))
        for column in columns:
            for start in range(0, count, BLOCK):
                values = column(hills(start, min(count, start + BLOCK), count, degree))
                file.write(values.clip(0, 255).astype("u1").tobytes())


def write_sog(path: Path, count: int, degree: int) -> None:
    """Of degree 0, or with a palette that has one entry for all."""
    width = -(-math.isqrt(count) // 4) * 4 + 4
    shape = (-(-count // width), width)
    names = {"means": ("means_l", "means_u"), "scales": ("scales",), "quats": ("quats",), "sh0": ("sh0",)}
    codebooks = {"scales": np.linspace(-12, 2, 256), "sh0": np.linspace(-2, 2, 256)}
    meta: dict[str, Any] = {"version": 2, "count": count}
    with zipfile.ZipFile(path, "w") as bundle:

        def image(name: str, channels: int, pixels: Callable[[dict[str, NDArray[np.float32]]], NDArray[Any]]) -> None:
            whole = np.zeros((shape[0] * width, channels), np.uint8)
            for start in range(0, count, BLOCK):
                rows = hills(start, min(count, start + BLOCK), count, degree)
                whole[start : start + len(rows["means"])] = pixels(rows)
            add(f"{name}.webp", whole.reshape(*shape, channels))

        def add(name: str, pixels: NDArray[np.uint8]) -> None:
            content = io.BytesIO()
            Image.fromarray(pixels).save(content, "webp", lossless=True, quality=0, method=0, exact=True)
            bundle.writestr(name, content.getvalue())

        for name, files in names.items():
            book = {"codebook": codebooks[name].tolist()} if name in codebooks else {}
            meta[name] = {"files": [f"{file}.webp" for file in files], **book}
        meta["means"] |= {"mins": [-4.0] * 3, "maxs": [4.0] * 3}
        image("means_l", 3, lambda rows: _places(rows) & 255)
        image("means_u", 3, lambda rows: _places(rows) >> 8)
        image("scales", 3, lambda rows: np.digitize(rows["scales"], codebooks["scales"][1:]))
        image(
            "quats",
            4,
            lambda rows: np.column_stack((rows["rotation"][:, 1:] * 16 + 128, np.full(len(rows["rotation"]), 252))),
        )
        image("sh0", 4, lambda rows: np.column_stack((
            np.digitize(rows["sh"][:, 0], codebooks["sh0"][1:]), 255 / (1 + np.exp(-rows["opacity"]))
        )))  # fmt: skip
        if degree:
            palette = {"count": 1, "bands": degree, "codebook": codebooks["sh0"].tolist()}
            meta["shN"] = {**palette, "files": ["centroids.webp", "labels.webp"]}
            add("centroids.webp", np.full((1, 64 * ((degree + 1) ** 2 - 1), 3), 128, np.uint8))
            image("labels", 3, lambda rows: np.zeros((len(rows["means"]), 3)))
        bundle.writestr("meta.json", json.dumps(meta))


def _places(rows: dict[str, NDArray[np.float32]]) -> NDArray[np.int64]:
    """Positions, as SOG has them in 16 bits for logarithms from -4 to 4."""
    logarithms = np.sign(rows["means"]) * np.log1p(np.abs(rows["means"]))
    return np.rint((logarithms + 4) / 8 * 65535).clip(0, 65535).astype(np.int64)


WRITERS = {"ply": write_ply, "spz": write_spz, "sog": write_sog}
