"""Made-up runs: records written by hand, to test the figures computed from them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.scenes import ALONE
from tigas_common.pose import Pose
from tigas_common.wire.dash import RepresentationInfo
from tigas_common.wire.render import RenderRequest, ServerTiming
from tigas_common.wire.shaper import LinkSetting
from tigas_experiments.quality.picture import CaptureQuality, Quality
from tigas_experiments.records.folder import RunRecord, RunWriter, Snapshot
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine
from tigas_experiments.wire.recording import (
    Input,
    Lens,
    LinkSample,
    PlayedStream,
    Recording,
    Reply,
    Sample,
    ShownFrame,
    Traffic,
)
from tigas_experiments.wire.run import Configuration, Mode, Network

MACHINE = Machine(
    system="Linux 6",
    processor="Slow & Steady <1>",
    processors=2,
    memory_gb=4.0,
    python="3.11",
    tigas="0",
    commit=None,
    packages={"aioquic": "1"},
)
SERVER = ALONE.model_copy(update={"tcp_congestion_control": "cubic", "version": "9", "commit": "abc", "device": "GPU"})
LINK = Network(link=LinkSetting(down_kbps=20_000, up_kbps=10_000, delay_ms=10))
LENS = Lens(width=64, height=36, fx=30, fy=30, cx=32, cy=18)
STREAM = PlayedStream(
    player="dash.js 5.0",
    representations=(
        RepresentationInfo(id="r2-1414", rung=2, width=640, height=360, bitrate_kbps=1414, codecs="avc1.42c01e"),
    ),
    frame_rate=30,
    segment_s=1.0,
    frames_per_chunk=1,
    target_latency_ms=120,
)


def inputs(count: int, every_ms: float = 20.0, start: float = 0.0, first: int = 1) -> list[Input]:
    return [
        Input(
            at=start + index * every_ms, pose=first + index, position=(float(index), 0.0, 0.0), quaternion=(0, 0, 0, 1)
        )
        for index in range(count)
    ]


def frame(
    at: float, pose: int, rung: int | None = 2, height: int = 360, view: int | None = None, filled: float | None = None
) -> ShownFrame:
    """One on the screen; with `view`, turned to that pose."""
    return ShownFrame(
        side="stateless", at=at, pose=pose, view=view, filled=filled, latencies=(), rung=rung,
        width=height * 16 // 9, height=height,
    )  # fmt: skip


def late(entries: Sequence[Input], by_ms: float) -> list[ShownFrame]:
    """A frame for each input, after a fixed delay."""
    return [frame(entry.at + by_ms, entry.pose) for entry in entries]


def reply(asked_at: float, took_ms: float, pose: int = 1, rung: int | None = 2) -> Reply:
    """A received frame, with 12 ms at the server and 5 on the link."""
    at = asked_at + took_ms
    return Reply(
        at=at,
        asked_at=asked_at,
        first_byte_at=at - 5,
        pose=pose,
        asked_rung=rung,
        rung=rung,
        bytes=20_000,
        server=ServerTiming(queue=0, render=11, encode=1),
        throughput_kbps=32_000,
    )


def sampled(seq: int, at: float = 100.0, **changes: Any) -> Sample:
    """A frame that was kept: of request number `seq`, which stands `seq` units along x."""
    request = RenderRequest.at("courtyard", Pose.from_quaternion((seq, 0, 0), (0, 0, 0, 1)), LENS.intrinsics, profile=2)
    fields = {"seq": seq, "at": at, "request": request.model_copy(update={"seq": seq}), "rung": 2, "bytes": 20_000}
    return Sample.model_validate({**fields, "width": 64, "height": 36, **changes})


def recording(**changes: Any) -> dict[str, Any]:
    sampled = inputs(50)
    made = Recording(
        scene="courtyard",
        mode="stateless",
        transport="webtransport-streams",
        user_agent="Chromium",
        lens=LENS,
        started_unix_ms=1e12,
        duration_ms=1000.0,
        ended_ms=1040.0,
        complete=True,
        hidden=False,
        inputs=tuple(sampled),
        frames=tuple(late(sampled, 40)),
        captures=(),
        traffic=(Traffic(at=0.0, bytes=0), Traffic(at=1000.0, bytes=125_000)),
    )
    return {**made.model_dump(mode="json"), **changes}


def configuration(mode: Mode = "stateless", **changes: Any) -> Configuration:
    fields = {"scene": "courtyard", "movement": "stroll", "network": LINK, "mode": mode, "duration_s": 1.0}
    return Configuration.model_validate({**fields, "width": 640, "height": 360, **changes})


def write_run(
    folder: Path, mode: Mode = "stateless", delay_ms: float = 40.0, busy: float = 0.5, **changes: Any
) -> Path:
    sampled = inputs(50)
    frames = [f.model_dump() for f in late(sampled, delay_ms)]
    made = Recording.model_validate(
        recording(frames=frames, dash=None if mode == "stateless" else STREAM), strict=False
    )
    record = RunRecord(
        configuration=configuration(mode, **changes),
        machine=MACHINE,
        started="2026-01-01T00:00:00+00:00",
    )
    writer = RunWriter(folder, record)
    writer.recording(made)
    load = [LoadSample(unix_ms=1e12, cpu=busy, load_average=1.0)]
    writer.write(LinkSample, [sample(at) for at in (0.0, 500.0, 1000.0)])
    writer.write(LoadSample, load)
    writer.capture(0, png(100))
    writer.snapshot(Snapshot(at=500.0, capture=0), png(200))
    quality = Quality(psnr_db=30.0, ssim=0.9)
    writer.write(
        CaptureQuality,
        [
            CaptureQuality(
                at=500.0,
                pose=20,
                rung=2,
                picture=quality,
                view=Quality(psnr_db=20.0, ssim=0.6),
                seen=Quality(psnr_db=18.0, ssim=0.5),
            )
        ],
    )
    writer.close(status="complete", browser="156", backend="netem", load=Load.summarise(load), recording=made.head)
    return folder


def sample(at: float, delivered_kbps: float = 5000.0) -> LinkSample:
    return LinkSample(
        at=at,
        position_ms=at + 12,
        target_kbps=20_000,
        delivered_kbps=delivered_kbps,
        queue_ms=1,
        drops=3,
        up_delivered_kbps=100,
    )


def png(shade: int = 128, width: int = 64, height: int = 36, *, blue: int = 0, form: str = "PNG") -> bytes:
    """A picture with a gradient, so that it has a structure; in another form if that is named."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[:, :, 0] = np.linspace(0, 255, width, dtype=np.uint8)
    pixels[:, :, 1:] = shade, blue
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, form)
    return buffer.getvalue()
