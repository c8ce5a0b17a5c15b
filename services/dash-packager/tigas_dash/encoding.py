"""One rendered frame in, one encoded frame of every representation out."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import av
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter

from tigas_dash.cmaf.chunk import Sample
from tigas_dash.encoder import Encoder, EncoderName
from tigas_dash.errors import EncoderUnavailable
from tigas_dash.representation import Representation

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RawFrame:
    """A rendered view."""

    data: bytes
    """I420: planar yuv420p in BT.709, limited range, without padding."""
    width: int
    height: int
    pose: int
    """The number of the pose that it shows."""


class LadderEncoder:
    """The encoders of all representations: the largest has the rendered size, the others are scaled from it.

    Not thread-safe.
    """

    def __init__(
        self, name: EncoderName, ladder: Sequence[Representation], frame_rate: int, keyframe_every: int
    ) -> None:
        """Raises EncoderUnavailable."""
        self._name = name
        self._ladder = ladder
        self._frame_rate = frame_rate
        self._keyframe_every = keyframe_every
        self._encoders = self._open()
        self._scale = VideoReformatter()
        self._scaled: tuple[RawFrame, list[av.VideoFrame]] | None = None
        self.failures = 0
        self.parameters = [encoder.parameters for encoder in self._encoders]
        """One for each representation."""

    def encode(self, frame: RawFrame, number: int) -> list[Sample]:
        """The frame with this `number` in the stream, once for each representation.

        A failing encoder is replaced, and the stream continues with a keyframe. Raises EncoderUnavailable if that
        fails.
        """
        images = self._images(frame)
        keyframe = number % self._keyframe_every == 0
        try:
            return self._encode(images, number, keyframe)
        except (av.FFmpegError, ValueError) as error:
            self.failures += 1
            logger.warning("The encoder failed at frame %d and is replaced: %s", number, error)
        self._encoders = self._open()
        if [encoder.parameters for encoder in self._encoders] != self.parameters:
            raise EncoderUnavailable("The encoder failed, and its replacement does not fit the stream.")
        try:
            return self._encode(images, number, True)
        except (av.FFmpegError, ValueError) as error:
            raise EncoderUnavailable(f"The encoder failed twice at one frame: {error}.") from None

    def _encode(self, images: Sequence[av.VideoFrame], number: int, keyframe: bool) -> list[Sample]:
        pairs = zip(self._encoders, images, strict=True)
        return [encoder.encode(image, number, keyframe=keyframe) for encoder, image in pairs]

    def _open(self) -> list[Encoder]:
        return [Encoder(self._name, representation, self._frame_rate) for representation in self._ladder]

    def _images(self, frame: RawFrame) -> list[av.VideoFrame]:
        """The frame at every resolution; a frame that is repeated is not scaled again."""
        if self._scaled is None or self._scaled[0] is not frame:
            planes = np.frombuffer(frame.data, np.uint8).reshape(frame.height * 3 // 2, frame.width)
            whole = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            images = [
                whole
                if (one.width, one.height) == (frame.width, frame.height)
                else self._scale.reformat(whole, one.width, one.height, interpolation=Interpolation.AREA)
                for one in self._ladder
            ]
            self._scaled = frame, images
        return self._scaled[1]
