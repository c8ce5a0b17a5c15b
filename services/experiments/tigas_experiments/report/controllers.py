"""Names and styles of compared items: controllers, fixed rungs, DASH presets and representations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from tigas_common.wire.dash import RepresentationRequest
from tigas_experiments.wire.run import DASH_TRANSPORTS, MODE_NAMES, OFF, PER_VIEW, Configuration, Mode

LineStyle = Literal["-", "--", ":", "-."]
CONTROLLER_TITLES = {
    "latency": "Latency",
    "latency-transfer": "Latency (transfer)",
    "seen": "Seen",
    "lol+": "LoL+",
    "l2a": "L2A",
}
"""Titles as on the page; custom controllers are shown by name."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


@dataclass(frozen=True, slots=True)
class LineLook:
    """Line style: colour, dashes and marker are distinctive each."""

    colour: str
    dashes: LineStyle
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        return {"color": self.colour, "linestyle": self.dashes}


KNOWN_LOOKS = {
    "latency": LineLook("#cc79a7", "-", "s"),
    "latency-transfer": LineLook("#cc79a7", "--", "D"),
    "seen": LineLook("#0072b2", "-", "o"),
    "lol+": LineLook("#e69f00", "-", "^"),
    "l2a": LineLook("#56b4e9", "-", "v"),
    "dash-typical": LineLook("#d55e00", "--", "X"),
    "dash-tuned": LineLook("#009e73", "--", "P"),
    "dash-edge": LineLook("#1c2430", "--", "*"),  # the text colour, which changes on a dark page
    "webrtc": LineLook("#117733", "--", "p"),
    "local-ply": LineLook("#8844dd", "-.", "h"),
    "local-compressed": LineLook("#885588", "-.", "d"),
    "local-streamed": LineLook("#aa4499", "-.", "p"),
}
"""Okabe and Ito's colour-blind palette."""
OTHER_COLOURS = ("#999933", "#882255", "#44aa99", "#ddcc77")
FIXED_COLOUR = "#7b8490"
USUAL = "seen"
"""The page's default, which has the most variants to compare."""
STAGES = {
    (True, False): LineLook("#dd0044", "--", "<"),
    (False, True): LineLook("#bb66ff", ":", ">"),
    (True, True): LineLook("#7733ff", "-.", "8"),
}
"""Looks by whether frames are reprojected and whether they are enhanced."""
FIXED_DASHES: tuple[LineStyle, ...] = (":", "-.", "--", "-")


@dataclass(frozen=True, slots=True)
class Controller:
    """A controller, a fixed rung, or a DASH preset, perhaps with a single representation."""

    mode: Mode
    profile: int | str | None
    """None in modes without profiles."""
    representation: RepresentationRequest | None = None
    """The single representation of a DASH stream."""
    over_h3: bool = False
    """Whether the segments of a DASH stream came over HTTP/3."""
    enhancement: str | None = None
    """Enhancement models, such as `anime4k-restore-m + scene`."""
    motion: tuple[str, ...] = ()
    """Motion compensation, such as `reprojection` or `prediction-linear`."""

    @classmethod
    def from_configuration(cls, configuration: Configuration) -> Controller:
        mode = configuration.mode
        if mode not in PER_VIEW:
            representation, over_h3 = configuration.dash_representation, configuration.over_h3
            return cls(mode, None, representation, over_h3, motion=configuration.motion)
        models = [model for model in (configuration.restore, configuration.upscale) if model != OFF]
        return cls(mode, configuration.profile, enhancement=" + ".join(models) or None, motion=configuration.motion)

    @property
    def is_fixed(self) -> bool:
        return isinstance(self.profile, int) or self.representation is not None

    @property
    def unenhanced(self) -> Controller:
        """The same controller without changes to frames."""
        return replace(self, enhancement=None, motion=())

    @property
    def name(self) -> str:
        """Machine-readable name: `latency`, `profile-2`, `dash-tuned`."""
        profile = f"profile-{self.profile}" if isinstance(self.profile, int) else self.profile
        name = self._joined("-", None if self.mode == "stateless" else self.mode, "h3" if self.over_h3 else profile)
        return "+".join((name, *([self.enhancement.replace(" ", "")] if self.enhancement else []), *self.motion))

    @property
    def title(self) -> str:
        mode = self.mode_title
        profile = f"Profile {self.profile}" if isinstance(self.profile, int) else self.profile
        name = self._joined(
            " ", None if self.mode == "stateless" else mode, CONTROLLER_TITLES.get(str(profile), profile)
        )
        return " + ".join((name, *self.stages))

    @property
    def title_with_mode(self) -> str:
        """Display name for comparisons of modes."""
        profile = f"rung {self.profile}" if isinstance(self.profile, int) else self.profile
        return " + ".join((self._joined(", ", self._mode, profile), *self.stages))

    @property
    def mode_title(self) -> str:
        """The mode and, for a stream over HTTP/3, the transport; without commas, for lists."""
        return self._mode.replace(",", "")

    @property
    def _mode(self) -> str:
        return MODE_NAMES[self.mode] + (f", {DASH_TRANSPORTS['h3']}" if self.over_h3 else "")

    @property
    def stages(self) -> list[str]:
        """Display names of the changes made to frames."""
        return [*([self.enhancement] if self.enhancement else []), *(word.replace("-", " ") for word in self.motion)]

    def _joined(self, separator: str, *parts: object) -> str:
        return separator.join(str(part) for part in (*parts, self.representation) if part is not None)


def sort_controllers(controllers: Iterable[Controller]) -> list[Controller]:
    """Distinct controllers by mode: known ones, custom ones, then fixed rungs or representations."""
    known, modes = list(CONTROLLER_TITLES), list(MODE_NAMES)

    def kind(controller: Controller) -> tuple[int, int, str]:
        profile, enhancement = controller.profile, controller.enhancement or ""
        if isinstance(profile, int):
            return 2, profile, enhancement
        if profile is None:
            one = controller.representation
            return 0, int(controller.over_h3), "" if one is None else f"{one.bitrate_kbps or 0:09} {one.rung}"
        return (0, known.index(profile), enhancement) if profile in known else (1, 0, f"{profile} {enhancement}")

    return sorted(set(controllers), key=lambda one: (modes.index(one.mode), *kind(one), one.motion))


def run_names(runs: Sequence[Configuration]) -> dict[str, str]:
    """Display names of an experiment's runs by folder: `DASH tuned, 20mbit,20ms-rtt, stroll`."""
    scenes, segments, repeats = ({getattr(run, name) for run in runs} for name in ("scene", "segment", "repeat"))

    def parts(run: Configuration) -> Iterator[str]:
        yield Controller.from_configuration(run).title_with_mode.replace(",", "")
        yield run.network.label
        yield Path(run.movement).stem
        if len(scenes) > 1:
            yield run.scene
        if len(segments) > 1:
            yield f"part {run.segment + 1}"
        if len(repeats) > 1:
            yield f"repeat {run.repeat + 1}"

    return {run.slug: ", ".join(parts(run)) for run in runs}


def assign_looks(controllers: Iterable[Controller]) -> dict[Controller, LineLook]:
    """A style for each controller; known controllers have the same style in every report.

    Variants of frames have separate styles only if several variants of the controller are compared.
    """
    ordered = sort_controllers(controllers)
    variants = Counter(controller.unenhanced for controller in ordered)
    found: dict[Controller, LineLook] = {}
    others = 0
    for controller in ordered:
        look = _default_look(controller, place=sum(each.mode == controller.mode and each.is_fixed for each in found))
        if look is not None and controller != controller.unenhanced and variants[controller.unenhanced] > 1:
            look = _distinguish(look, controller)
        if look is None or look in found.values():
            look = LineLook(OTHER_COLOURS[others % len(OTHER_COLOURS)], "-", MARKERS[-1 - others % len(MARKERS)])
            others += 1
        found[controller] = look
    return found


def _default_look(controller: Controller, place: int) -> LineLook | None:
    """Predefined look of a controller, if any; `place` counts the preceding fixed controllers of its mode."""
    if controller.over_h3:
        look = _default_look(replace(controller, over_h3=False), place)
        return None if look is None else replace(look, dashes="-.")
    if not controller.is_fixed:
        return KNOWN_LOOKS.get(controller.unenhanced.name)
    if isinstance(controller.profile, int):
        if controller.mode != "stateless":
            return None
        place, colour = controller.profile, FIXED_COLOUR
    else:
        colour = KNOWN_LOOKS[controller.mode].colour
    return LineLook(colour, FIXED_DASHES[place % len(FIXED_DASHES)], MARKERS[place % len(MARKERS)])


def _distinguish(look: LineLook, controller: Controller) -> LineLook:
    """A distinct look for a variant: dashes and marker, and the colour too for the default controller."""
    stage = STAGES[bool(controller.motion), controller.enhancement is not None]
    colour = stage.colour if controller.unenhanced.name == USUAL else look.colour
    return LineLook(colour, ":" if stage.dashes == look.dashes else stage.dashes, stage.marker)
