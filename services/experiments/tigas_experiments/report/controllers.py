"""What an experiment compares: controllers, fixed rungs, DASH's presets and single representations; each has one name
and one look throughout.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

from tigas_common.wire.dash import RepresentationRequest
from tigas_common.wire.run import MODE_NAMES, MODES, PER_VIEW, Configuration, Mode

LineStyle = Literal["-", "--", ":", "-."]
CONTROLLER_TITLES = {
    "latency": "Latency",
    "latency-transfer": "Latency (transfer)",
    "budget": "Budget",
    "lol+": "LoL+",
    "l2a": "L2A",
}
"""As the page has them; a controller of one's own is called by its name."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


@dataclass(frozen=True, slots=True)
class Look:
    """How its lines and points are drawn: colour, dashes and marker each tell it apart."""

    colour: str
    dashes: LineStyle
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """As matplotlib takes them for a line."""
        return {"color": self.colour, "linestyle": self.dashes}


KNOWN_LOOKS = {
    "latency": Look("#cc79a7", "-", "s"),
    "latency-transfer": Look("#cc79a7", "--", "D"),
    "budget": Look("#0072b2", "-", "o"),
    "lol+": Look("#e69f00", "-", "^"),
    "l2a": Look("#56b4e9", "-", "v"),
    "dash-typical": Look("#d55e00", "--", "X"),
    "dash-tuned": Look("#009e73", "--", "P"),
    "dash-edge": Look("#1c2430", "--", "*"),  # the text's colour, which is another one in the dark
    "webrtc": Look("#117733", "--", "p"),
    "local-ply": Look("#8844dd", "-.", "h"),
    "local-compressed": Look("#885588", "-.", "d"),
}
"""Okabe and Ito's colours, which people with colour blindness tell apart."""
OTHER_COLOURS = ("#999933", "#882255", "#44aa99", "#ddcc77")
FIXED_COLOUR = "#7b8490"
USUAL = "budget"
"""The page's own choice, which is compared with itself most often."""
STAGES = {
    (True, False): Look("#dd0044", "--", "<"),
    (False, True): Look("#bb66ff", ":", ">"),
    (True, True): Look("#7733ff", "-.", "8"),
}
"""Of what is done to a controller's frames: whether they are turned to the view, and whether they are enhanced."""
FIXED_DASHES: tuple[LineStyle, ...] = (":", "-.", "--", "-")


@dataclass(frozen=True, slots=True)
class Controller:
    """What decides the profile: a controller, a fixed rung, or a preset of DASH, perhaps of one representation."""

    mode: Mode
    profile: int | str | None
    """None in the modes that have none."""
    representation: RepresentationRequest | None = None
    """The only one that a DASH stream had."""
    enhancement: str | None = None
    """The models that enhanced the frames, such as `anime4k-restore-m + scene`."""
    motion: tuple[str, ...] = ()
    """How the page met movement, such as `reprojection`, `prediction-auto`."""

    @classmethod
    def of(cls, configuration: Configuration) -> Controller:
        """Of a run."""
        mode = configuration.mode
        if mode not in PER_VIEW:
            return cls(mode, None, configuration.dash_representation, motion=configuration.motion)
        models = [model for model in (configuration.restore, configuration.upscale) if model != "off"]
        return cls(mode, configuration.profile, enhancement=" + ".join(models) or None, motion=configuration.motion)

    @property
    def fixed(self) -> bool:
        """Whether nothing adapts."""
        return isinstance(self.profile, int) or self.representation is not None

    @property
    def plain(self) -> bool:
        """Whether frames were shown as they came."""
        return self.enhancement is None and not self.motion

    @property
    def bare(self) -> Controller:
        """The same, with frames shown as they come."""
        return replace(self, enhancement=None, motion=())

    @property
    def name(self) -> str:
        """For programs: `latency`, `profile-2`, `dash-tuned`."""
        if self.profile is None:
            name = self._with_representation(self.mode, "-")
        else:
            name = f"profile-{self.profile}" if isinstance(self.profile, int) else self.profile
            name = name if self.mode == "stateless" else f"{self.mode}-{name}"
        return "+".join((name, *([self.enhancement.replace(" ", "")] if self.enhancement else []), *self.motion))

    @property
    def title(self) -> str:
        """For people."""
        if self.profile is None:
            name = self._with_representation(MODE_NAMES[self.mode].replace(",", ""), " ")  # without commas, for lists
            return self._with_stages(name)
        fixed = isinstance(self.profile, int)
        name = f"Profile {self.profile}" if fixed else CONTROLLER_TITLES.get(str(self.profile), str(self.profile))
        return self._with_stages(name if self.mode == "stateless" else f"{MODE_NAMES[self.mode]} {name}")

    @property
    def title_with_mode(self) -> str:
        """For people who compare modes."""
        if self.profile is None:
            return self._with_stages(self._with_representation(MODE_NAMES[self.mode], ", "))
        profile = f"rung {self.profile}" if isinstance(self.profile, int) else self.profile
        return f"{MODE_NAMES[self.mode]}, {self._with_stages(profile)}"

    def _with_stages(self, name: str) -> str:
        stages = [*([self.enhancement] if self.enhancement else []), *(word.replace("-", " ") for word in self.motion)]
        return " + ".join((name, *stages))

    def _with_representation(self, name: str, separator: str) -> str:
        return name if self.representation is None else f"{name}{separator}{self.representation}"


def in_order(controllers: Iterable[Controller]) -> list[Controller]:
    """Each once, mode by mode: the known controllers, one's own, fixed rungs; or a stream's representations."""
    known = list(CONTROLLER_TITLES)

    def place(controller: Controller) -> tuple[int, int, int, str, tuple[str, ...]]:
        return MODES.index(controller.mode), *kind(controller), controller.motion

    def kind(controller: Controller) -> tuple[int, int, str]:
        profile, enhancement = controller.profile, controller.enhancement or ""
        if isinstance(profile, int):
            return 2, profile, enhancement
        if profile is None:
            one = controller.representation
            return 0, 0, "" if one is None else f"{one.bitrate_kbps or 0:09} {one.rung}"
        return (0, known.index(profile), enhancement) if profile in known else (1, 0, f"{profile} {enhancement}")

    return sorted(set(controllers), key=place)


def looks(controllers: Iterable[Controller]) -> dict[Controller, Look]:
    """One for each; the known ones' are the same in every report. What is done to frames shows only where a controller
    is compared with itself without it, or with something else done."""
    ordered = in_order(controllers)
    variants = Counter(controller.bare for controller in ordered)
    found: dict[Controller, Look] = {}
    others = 0
    for controller in ordered:
        look = _usual(controller, place=sum(each.mode == controller.mode and each.fixed for each in found))
        if look is not None and not controller.plain and variants[controller.bare] > 1:
            look = _set_apart(look, controller)
        if look is None or look in found.values():
            look = Look(OTHER_COLOURS[others % len(OTHER_COLOURS)], "-", MARKERS[-1 - others % len(MARKERS)])
            others += 1
        found[controller] = look
    return found


def _usual(controller: Controller, place: int) -> Look | None:
    """Whatever is done to its frames; None: it has none. `place`: how many fixed ones of its mode came before it."""
    if controller.representation is not None:
        colour = KNOWN_LOOKS[controller.mode].colour
        return Look(colour, FIXED_DASHES[place % len(FIXED_DASHES)], MARKERS[place % len(MARKERS)])
    if isinstance(controller.profile, int):
        rung = controller.profile
        look = Look(FIXED_COLOUR, FIXED_DASHES[rung % len(FIXED_DASHES)], MARKERS[rung % len(MARKERS)])
        return look if controller.mode == "stateless" else None
    return KNOWN_LOOKS.get(controller.bare.name)


def _set_apart(look: Look, controller: Controller) -> Look:
    """By dashes and marker, and the usual controller by colours of its own."""
    stage = STAGES[bool(controller.motion), controller.enhancement is not None]
    colour = stage.colour if controller.bare.name == USUAL else look.colour
    return Look(colour, ":" if stage.dashes == look.dashes else stage.dashes, stage.marker)
