"""What capacity plans rest on: figures that were measured, each with the document and the commit it is from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measured:
    """A figure as its document prints it."""

    what: str
    printed: str
    unit: str
    document: str
    """In `docs`."""
    commit: str

    @property
    def value(self) -> float:
        """In `unit`."""
        return float(self.printed.replace(",", ""))


LOAD, COMPARE = ("load.md", "4801556"), ("compare.md", "d4d7988")

SMALL_VIEWERS = Measured("640×360: an H200 with 16 cores serves, all in time", "100", "viewers", *LOAD)
SMALL_CORES = Measured("640×360: processors that this takes", "4.8", "cores", *LOAD)
SMALL_KB = Measured("640×360: a frame of *flowers*", "9", "kB", *LOAD)
LARGE_VIEWERS = Measured("1280×720: the same service serves, all in time", "90", "viewers", *LOAD)
LARGE_CORES = Measured("1280×720: processors that this takes", "5.5", "cores", *LOAD)
LARGE_KB = Measured("1280×720: a frame of *flowers*", "61", "kB", *LOAD)
OFFERED_PER_S = Measured("each of these viewers asks for", "30", "frames/s", *LOAD)
PAGE_VIEWS_PER_S = Measured("the page over 20 Mbit/s and mobile links: new views", "53.7", "views/s", *COMPARE)
PAGE_MBIT_PER_S = Measured("the page over 20 Mbit/s and mobile links: it receives", "10.2", "Mbit/s", *COMPARE)
PAGE_ROUND_TRIP_MS = Measured("the page: round trip of those links", "20", "ms", *COMPARE)
PAGE_RESPONSE_MS = Measured("the page: motion to photon over them, median", "65", "ms", *COMPARE)
READMIT = Measured("utilisation below which a full service takes new viewers", "0.7", "", *LOAD)

FIGURES = [figure for figure in globals().values() if isinstance(figure, Measured)]
