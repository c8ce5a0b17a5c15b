"""Error of reprojected late frames by the angle that the camera turned meanwhile, from the captures of experiments.

    python -m benchmarks.seen_error results/paper/rivals … --check results/paper/controllers-turned
    python -m benchmarks.seen_error results/paper/rivals … --write web/packages/client/abr/seen-error.json

Captures of *Stateless* with reprojection and prediction have two errors, of their rung and of their age. With the
rung's error r from the ladder and the angle t between a frame's pose and the viewer's, in degrees, this fits

    mse = ((c·r)^1.5 + (a·(t/10)^p)^1.5)^(1/1.5)
    1 − SSIM = ((d·s)^3 + (b·(t/10)^q)^3)^(1/3)        where s is the rung's loss of SSIM

and prints how far the fit and the present table are from captures, also from those of experiments to check. c and d
allow for displays with fewer lines than the ladder's pictures have. --write replaces the table's entry `predicted`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table
from scipy.optimize import least_squares

from tigas_common.terminal import make_console

Floats = NDArray[np.float64]
TABLE = Path(__file__).parents[1] / "web/packages/client/abr/seen-error.json"
TURNS = (0.59, 1.56, 3.31, 5.72, 9.36, 14.89, 23.75, 40.0, 64.66)
"""Angles of the table, in degrees."""
DEGREES = 1.5, 3.0
"""Of the norms of mean squared errors and of losses of SSIM, as in seen-error.ts."""
PEAK = 255.0**2
SSIM_WEIGHT = 15.0
"""Decibels that an SSIM of 1 is worth in the fit."""
FIRST, LOW, HIGH = (0.7, 20, 1, 0.8, 0.05, 0.7), (0.1, 0.1, 0.2, 0.1, 0.001, 0.1), (2, 500, 3, 2, 0.5, 3)
"""Start and limits of c, a, p, d, b and q."""


def captures(run: Path) -> Iterator[tuple[float, float, float, float]]:
    """The angle, the rung's PSNR, and PSNR and SSIM of each capture of a run with reprojection and prediction."""
    record = json.loads((run / "run.json").read_bytes())
    made = record["configuration"]
    if record["status"] != "complete" or made["mode"] != "stateless" or not made["reprojection"]:
        return
    if made["prediction"] == "off" or not (run / "quality.ndjson").exists():
        return
    inputs = _lines(run / "inputs.ndjson")
    times = [one["at"] for one in inputs]
    poses = {one["pose"]: one["quaternion"] for one in inputs}
    for one in _lines(run / "quality.ndjson"):
        latest = inputs[max(0, int(np.searchsorted(times, one["at"], side="right")) - 1)]
        if one["pose"] not in poses or one["seen"] is None:
            continue
        cosine = abs(float(np.dot(poses[one["pose"]], latest["quaternion"])))
        angle = 2 * float(np.degrees(np.arccos(min(1.0, cosine))))
        psnr_db = record["server"]["ladder"][one["rung"]]["psnr_db"]
        if psnr_db is not None:  # the paper's ladder has none
            yield angle, psnr_db, one["seen"]["psnr_db"], one["seen"]["ssim"]


def _lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def of_folders(folders: Sequence[Path]) -> Floats:
    """Captures of experiments [n, 4], as `captures` has them. Raises SystemExit if there are none."""
    found = [one for folder in folders for run in sorted((folder / "runs").iterdir()) for one in captures(run)]
    if not found:
        raise SystemExit("No run has captures of Stateless with reprojection and prediction.")
    return np.array(found, np.float64)


def errors(
    late: tuple[Floats, Floats], psnr: Floats, rungs: Floats, scale: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Mean squared error and loss of SSIM of pictures with both faults."""
    own = PEAK * 10 ** (-psnr / 10), 1 - np.interp(psnr, rungs[:, 0], rungs[:, 1])
    mse, loss = (
        ((factor * one) ** degree + two**degree) ** (1 / degree)
        for factor, one, two, degree in zip(scale, own, late, DEGREES, strict=True)
    )
    return mse, loss


def fitted(found: Floats, rungs: Floats) -> Floats:
    """Parameters c, a, p, d, b and q that fit captures best."""

    def residuals(parameters: Floats) -> Floats:
        mse, loss = modelled(parameters, found, rungs)
        return np.concatenate([found[:, 2] - 10 * np.log10(PEAK / mse), SSIM_WEIGHT * (found[:, 3] - 1 + loss)])

    result: Floats = least_squares(residuals, FIRST, loss="soft_l1", bounds=(LOW, HIGH)).x
    return result


def modelled(parameters: Floats, found: Floats, rungs: Floats) -> tuple[Floats, Floats]:
    c, _, _, d, _, _ = parameters
    return errors(late_errors(parameters, np.maximum(found[:, 0], 0.05)), found[:, 1], rungs, (c, d))


def late_errors(parameters: Floats, turns: Floats) -> tuple[Floats, Floats]:
    """Of otherwise perfect pictures."""
    _, a, p, _, b, q = parameters
    return a * (turns / 10) ** p, b * (turns / 10) ** q


def tabulated(table: dict[str, Any], found: Floats, rungs: Floats) -> tuple[Floats, Floats]:
    """The same as `modelled`, by the present table."""
    points = [(0.0, 0.0, 1.0), *((one["turn_deg"], one["mse"], one["ssim"]) for one in table["late"]["predicted"])]
    turns, mse, ssim = np.array(points).T
    late = np.interp(found[:, 0], turns, mse), 1 - np.interp(found[:, 0], turns, ssim)
    return errors(late, found[:, 1], rungs, (1.0, 1.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="of experiments")
    parser.add_argument("--check", type=Path, nargs="+", default=[], help="of experiments that are not fitted")
    parser.add_argument("--write", type=Path, help="table to replace the entry of")
    options = parser.parse_args()
    table = json.loads(TABLE.read_text())
    rungs = np.array(sorted((one["psnr_db"], one["ssim"]) for one in table["rungs"]))
    sets = {"fitted": of_folders(options.folders)} | ({"checked": of_folders(options.check)} if options.check else {})
    parameters = fitted(sets["fitted"], rungs)
    shown = Table("captures", "", "by", "PSNR, dB: bias", "rms", "SSIM: bias", "rms", box=SIMPLE_HEAD)
    for name, found in sets.items():
        for by, (mse, loss) in {
            "table": tabulated(table, found, rungs),
            "fit": modelled(parameters, found, rungs),
        }.items():
            psnr, ssim = 10 * np.log10(PEAK / mse) - found[:, 2], 1 - loss - found[:, 3]
            cells = (f"{psnr.mean():+.2f}", f"{_rms(psnr):.2f}", f"{ssim.mean():+.3f}", f"{_rms(ssim):.3f}")
            shown.add_row(name, str(len(found)), by, *cells)
    make_console().print(shown)
    print("c, a, p, d, b, q =", ", ".join(f"{value:.3g}" for value in parameters))
    if options.write:
        turns = np.array(TURNS)
        late = zip(TURNS, *late_errors(parameters, turns), strict=True)
        table["late"]["predicted"] = [
            {"turn_deg": turn, "mse": round(mse, 1), "ssim": round(1 - loss, 4)} for turn, mse, loss in late
        ]
        options.write.write_text(json.dumps(table, indent=2) + "\n")


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    main()
