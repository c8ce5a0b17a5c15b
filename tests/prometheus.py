"""A service's `/metrics`, parsed like Prometheus does."""

from __future__ import annotations

import httpx
from prometheus_client.parser import text_string_to_metric_families


class Figures:
    """Of one moment."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.families = {family.name: family for family in text_string_to_metric_families(text)}
        self._samples = [sample for family in self.families.values() for sample in family.samples]

    def __call__(self, name: str, **labels: str) -> float:
        """The sum of a metric's samples that have these labels."""
        return sum(
            sample.value for sample in self._samples if sample.name == name and labels.items() <= sample.labels.items()
        )

    @property
    def names(self) -> set[str]:
        """Names of all samples, of counters and histograms as well; some have no value yet."""
        suffixes = {"counter": ("_total",), "histogram": ("_bucket", "_count", "_sum")}
        return {
            f"{family.name}{suffix}" for family in self.families.values() for suffix in suffixes.get(family.type, ("",))
        }

    def labels(self, name: str) -> set[str]:
        """The labels of a metric's samples."""
        return {label for sample in self._samples if sample.name == name for label in sample.labels}


async def figures(http: httpx.AsyncClient) -> Figures:
    """A service's now."""
    answer = await http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=")
    return Figures(answer.text)
