"""Runs with samples from a real render service."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import httpx

from tests.experiments.made_up import sampled, write_run
from tests.web.scenes import SMALL
from tests.web.server import RenderServer
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.samples import JPEG, write_sample_file, write_samples

NUMBERS = (8, 3, 40)


def sample_run(server: RenderServer, folder: Path, numbers: Iterable[int] = NUMBERS, **changes: Any) -> Path:
    """A run with the service's own frames as samples; `changes` apply to its configuration."""
    run = write_run(folder, scene=SMALL, **changes)
    samples = []
    with httpx.Client(base_url=server.url, timeout=60) as http:
        info = http.post(f"/scenes/{SMALL}/load").json()
        for seq in numbers:
            request = sampled(seq).request.model_copy(
                update={"scene": SMALL, "position": (0.01 * seq, 0.0, 0.0), "deadline_ms": 5000.0}
            )
            frame = http.post("/render", content=request.model_dump_json(exclude_none=True))
            assert frame.status_code == 200
            write_sample_file(run, seq, JPEG, frame.content)
            samples.append(sampled(seq, request=request, bytes=len(frame.content)))
    write_samples(run, samples)
    record = StoredRun(run).record.model_copy(update={"scene_sha256": info["file_sha256"]})
    (run / "run.json").write_text(record.model_dump_json())
    return run
