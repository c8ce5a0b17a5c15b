"""A load that a test chooses."""

from __future__ import annotations

from tigas_render.admission.load import Load


class ChosenLoad(Load):
    """As busy as the test says."""

    is_full = False
    rate: float | None = None

    def retry_after_s(self) -> float | None:
        return 5.0 if self.is_full else None

    @property
    def requests_per_s(self) -> float | None:
        return self.rate
