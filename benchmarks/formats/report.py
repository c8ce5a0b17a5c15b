"""What was measured as tables in Markdown and a plot: bytes at JPEG's picture, times, and on which links it pays."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from benchmarks.formats.codecs import TODAY
from benchmarks.formats.measure import Measured, Sample
from tigas_common.wire.render import DEFAULT_LADDER, Rung

Quality = Callable[[Sample], float]
RUNGS = {rung.width: rung for rung in DEFAULT_LADDER}


def psnr(sample: Sample) -> float:
    """PSNR in dB."""
    return sample.psnr_db


def ssim_db(sample: Sample) -> float:
    """SSIM on a scale that is about as even as that of PSNR."""
    return -10 * math.log10(1 - sample.ssim)


def curve(measured: Measured, codec: str, width: int) -> list[Sample]:
    """From poor to good, as measured; settings that cost more than a better one are left out."""
    samples = [each for each in measured.samples if each.codec == codec and each.width == width]
    kept: list[Sample] = []
    for sample in sorted(samples, key=lambda each: each.size):
        if not kept or min(psnr(sample) - psnr(kept[-1]), ssim_db(sample) - ssim_db(kept[-1])) > 0:
            kept.append(sample)
    return kept


def at_picture(samples: Sequence[Sample], quality: Quality, wanted: float) -> tuple[float, float]:
    """Bytes and milliseconds where the picture is as good as wanted; those of the curve's end where it is better."""
    known = [quality(each) for each in samples]
    size = np.interp(wanted, known, np.log([each.size for each in samples]))
    return math.exp(size), float(np.interp(wanted, known, [each.encode_ms for each in samples]))


def bjontegaard(anchor: Sequence[Sample], other: Sequence[Sample], quality: Quality) -> float:
    """How many more bytes the other needs at equal picture, as a share (VCEG-M33, with monotone cubic pieces).

    Averaged over the picture's range that both have.
    """
    low = max(quality(anchor[0]), quality(other[0]))
    high = min(quality(anchor[-1]), quality(other[-1]))
    means = []
    for samples in (anchor, other):
        rate = PchipInterpolator([quality(each) for each in samples], np.log([each.size for each in samples]))
        means.append(float(rate.integrate(low, high)) / (high - low))
    return math.exp(means[1] - means[0]) - 1


def break_even_mbit(saved_bytes: float, longer_ms: float) -> float:
    """The link rate below which fewer bytes arrive earlier, although they take longer to encode and decode."""
    if saved_bytes <= 0:
        return 0.0
    return math.inf if longer_ms <= 0 else saved_bytes * 8 / 1000 / longer_ms


def tables(scenes: Sequence[Measured]) -> str:
    """One table for each rung, and one of Bjøntegaard rates."""
    names = list(dict.fromkeys(sample.codec for sample in scenes[0].samples))
    parts = [rung_table(scenes, names, rung) for rung in DEFAULT_LADDER]
    return "\n\n".join([*parts, bjontegaard_table(scenes, names)]) + "\n"


def rung_table(scenes: Sequence[Measured], names: Sequence[str], rung: Rung) -> str:
    """Means over scenes, at the picture that today's JPEG has at the rung's quality."""
    rows = {name: np.mean([_row(scene, name, rung) for scene in scenes], axis=0) for name in names}
    today = rows[TODAY]
    lines = [
        f"**{rung.width}×{rung.height}, the picture of JPEG q{rung.quality}** "
        f"({today[0] / 1000:.1f} kB, encoded in {today[2]:.1f} ms, decoded in {today[3]:.1f} ms)",
        "",
        "| | bytes at equal PSNR | at equal SSIM | encode, ms | decode, ms | earlier below, Mbit/s |",
        "|---|---|---|---|---|---|",
    ]
    for name, (by_psnr, by_ssim, encode, decode) in rows.items():
        if name == TODAY:
            continue
        saved = today[0] - max(by_psnr, by_ssim)
        even = break_even_mbit(saved, encode - today[2] + decode - today[3])
        cells = [
            f"{by_psnr / today[0] - 1:+.0%}",
            f"{by_ssim / today[1] - 1:+.0%}",
            f"{encode:.1f}",
            "not decoded" if math.isnan(decode) else f"{decode:.1f}",
            "" if math.isnan(even) else "never" if even == 0 else "always" if math.isinf(even) else f"{even:.0f}",
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _row(scene: Measured, name: str, rung: Rung) -> tuple[float, float, float, float]:
    """Bytes at equal PSNR and at equal SSIM, milliseconds to encode and to decode."""
    reference = next(
        each for each in scene.samples if (each.codec, each.width, each.quality) == (TODAY, rung.width, rung.quality)
    )
    samples = curve(scene, name, rung.width)
    by_psnr, encode = at_picture(samples, psnr, psnr(reference))
    by_ssim, _ = at_picture(samples, ssim_db, ssim_db(reference))
    decode = [each.milliseconds for each in scene.decoding if (each.codec, each.width) == (name, rung.width)]
    return by_psnr, by_ssim, encode, decode[0] if decode else math.nan


def bjontegaard_table(scenes: Sequence[Measured], names: Sequence[str]) -> str:
    """By PSNR / by SSIM; the mean over scenes, and the least and the most."""
    sizes = list(RUNGS.values())
    lines = [
        "| Bjøntegaard rate by PSNR (scenes) / SSIM | "
        + " | ".join(f"{each.width}×{each.height}" for each in sizes)
        + " |",
        "|---" * (len(sizes) + 1) + "|",
    ]
    for name in names:
        if name == TODAY:
            continue
        cells = []
        for rung in sizes:
            pairs = [(curve(scene, TODAY, rung.width), curve(scene, name, rung.width)) for scene in scenes]
            by_psnr = [bjontegaard(*pair, psnr) for pair in pairs]
            by_ssim = np.mean([bjontegaard(*pair, ssim_db) for pair in pairs])
            spread = f"{min(by_psnr):+.0%} to {max(by_psnr):+.0%}"
            cells.append(f"{np.mean(by_psnr):+.0%} ({spread}) / {by_ssim:+.0%}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(scenes: Sequence[Measured], names: Sequence[str], file: Path) -> None:
    """PSNR over bytes: a row for each scene, a column for each size."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(len(scenes), len(RUNGS), figsize=(13, 2.9 * len(scenes)), squeeze=False)
    for scene, row in zip(scenes, grid, strict=True):
        for rung, axes in zip(RUNGS.values(), row, strict=True):
            for name in names:
                samples = curve(scene, name, rung.width)
                axes.plot([each.size / 1000 for each in samples], [psnr(each) for each in samples], ".-", label=name)
            axes.set_xscale("log")
            axes.set_title(f"{scene.scene}, {rung.width}×{rung.height}", fontsize=9)
            axes.grid(alpha=0.3, which="both")
            axes.tick_params(labelsize=7, which="both")
        row[0].set_ylabel("PSNR, dB")
    for axes in grid[-1]:
        axes.set_xlabel("kB")
    grid[0, 0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})
