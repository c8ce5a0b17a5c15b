"""Difference of a shown picture from ground truth: PSNR and SSIM of 8-bit RGB, at the viewport's resolution."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import Field

from tigas_common.wire.model import MAX_PIXELS, WireModel

Picture = NDArray[np.uint8]
"""[height, width, 3], RGB."""
MAX_PSNR_DB = 100.0
"""Used in place of the infinite PSNR of equal pictures."""
FORMATS = ("PNG", "JPEG", "WEBP")
Image.MAX_IMAGE_PIXELS = None  # Pillow would only warn about large images; `open_picture` refuses them


class BrokenPicture(Exception):
    """Reason why a picture cannot be compared, in one sentence."""


class Quality(WireModel):
    """Quality of a picture relative to another."""

    psnr_db: float
    ssim: float


class CaptureQuality(WireModel):
    """The screen at one moment, compared with ground truth in up to three ways."""

    at: float
    pose: int
    rung: int | None
    picture: Quality | None
    """Against the pose for which the frame was rendered: the cost of resolution and compression. None for frames from
    before the run, for reprojected frames, and with predicted poses.
    """
    view: Quality | None
    """Against the pose to which the frame was reprojected, which includes the cost of reprojection. Otherwise against
    the viewer's pose when the frame appeared, which includes the cost of lateness. None for frames from before the run.
    """
    seen: Quality | None = None
    """Against the viewer's pose at that moment, which includes the cost of ageing and freezes. None in early records,
    made when frames appeared.
    """
    uncovered: float | None = Field(default=None, ge=0, le=1)
    """Share of the picture that was never covered, which counts as black. None in early records."""


def decode_screen(data: bytes) -> tuple[Picture, float]:
    """Decode the screen, on black. Returns the picture and its share without pixels. Raises BrokenPicture."""
    with open_picture(data) as image:
        if "A" not in image.getbands():
            return np.asarray(image.convert("RGB")), 0.0
        whole = image.convert("RGBA")
        alpha = np.asarray(whole.getchannel("A"))
        black = Image.new("RGBA", whole.size, (0, 0, 0, 255))
        return np.asarray(Image.alpha_composite(black, whole).convert("RGB")), float(np.mean(alpha == 0))


def decode(data: bytes) -> Picture:
    """Decode a PNG, JPEG or WebP as RGB. Raises BrokenPicture."""
    with open_picture(data) as image:
        return np.asarray(image.convert("RGB"))


@contextmanager
def open_picture(data: bytes) -> Iterator[Image.Image]:
    """Open a picture in a supported format, with nothing but its size checked.

    Raises BrokenPicture, including for errors in the context.
    """
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            if image.width * image.height > MAX_PIXELS:
                raise BrokenPicture(f"A picture has {image.width}×{image.height} pixels; the limit is {MAX_PIXELS}.")
            yield image
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise BrokenPicture(f"A picture cannot be read: {error}.") from None


def encode(picture: Picture) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def upscale_bilinear(picture: Picture, width: int, height: int) -> Picture:
    """Scale bilinearly to a stage of this size, as browsers do."""
    if picture.shape[:2] == (height, width):
        return picture
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BILINEAR))


def upscale_bicubic(picture: Picture, width: int, height: int) -> Picture:
    """Scale to display size with Pillow's bicubic filter, the baseline for enhancement."""
    if picture.shape[:2] == (height, width):
        return picture
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BICUBIC))


def compare(shown: Picture, reference: Picture) -> Quality:
    """Compare `shown`, scaled to the size of `reference`, with it.

    SSIM as in Wang et al. 2004 (IEEE TIP 13) with Gaussian weights (σ = 1.5), mean over channels; PSNR over all
    channels. Raises BrokenPicture if the pictures are too small.
    """
    from skimage.metrics import structural_similarity  # heavy, and only needed to compute scores

    height, width = reference.shape[:2]
    if min(height, width) < 11:
        raise BrokenPicture("SSIM needs pictures of at least 11×11 pixels.")
    shown = upscale_bilinear(shown, width, height)
    error = float(np.mean(np.square(shown.astype(np.float32) - reference)))
    psnr = min(MAX_PSNR_DB, 10 * math.log10(255**2 / error)) if error else MAX_PSNR_DB
    ssim = structural_similarity(  # type: ignore[no-untyped-call]
        shown, reference, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    return Quality(psnr_db=psnr, ssim=float(ssim))
