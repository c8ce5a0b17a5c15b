"""What was on the screen at one moment of a run, beside what the viewer should have seen then."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

from PIL import Image

from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, enlarged
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.recording import BrokenRecording

MAX_WIDTH = 640
JPEG_QUALITY = 82


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Two pictures of one moment, as data: URLs."""

    label: str
    at_s: float
    shown: str
    view: str


def snapshot(run: StoredRun, label: str) -> Snapshot | None:
    """None if the run kept none. Raises BrokenRecording."""
    moment = run.moment()
    if moment is None:
        return None
    at, shown_png, view_png = moment
    try:
        shown, view = decode(shown_png), decode(view_png)
    except BrokenPicture as error:
        raise BrokenRecording(f"{run.folder}: {error}") from None
    height, width = view.shape[:2]
    return Snapshot(label, at / 1000, _url(enlarged(shown, width, height)), _url(view))


def _url(picture: Picture) -> str:
    image = Image.fromarray(picture)
    image.thumbnail((MAX_WIDTH, MAX_WIDTH))
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=JPEG_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"
