"""The compared controllers: names and styles."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.experiments.made_up import configuration
from tigas_experiments.report.controllers import Controller, assign_looks, run_names, sort_controllers
from tigas_experiments.wire.run import Configuration, Mode

PAGES = ("#ffffff", "#181b21")
"""Background colours of both themes."""
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
SIGHTS = {
    "usual": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
    "tritanopia": np.array([[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]]),
}
"""Simulates colour vision deficiency on linear sRGB: Machado, Oliveira and Fernandes (2009), severity 1."""


def test_a_controller_looks_the_same_in_every_report() -> None:
    def controller(
        mode: Mode = "stateless", profile: int | str = "seen", upscale: str = "off", **more: object
    ) -> Controller:
        return Controller.from_configuration(
            Configuration.model_validate(
                {
                    "scene": "s",
                    "movement": "stroll",
                    "network": {"trace": "x"},
                    "mode": mode,
                    "profile": profile,
                    "upscale": upscale,
                    "duration_s": 1.0,
                    "width": 64,
                    "height": 64,
                    **more,
                }
            )
        )

    seen, mine = controller(), controller(profile="mine")
    some = {
        seen,
        controller("dash-tuned"),
        controller("dash-tuned", "latency"),
        mine,
        controller(profile=3),
        controller(profile=3, upscale="scene"),
        controller(upscale="scene"),
        controller(profile=0),
        controller(reprojection=True, prediction="auto"),
        controller("dash-tuned", reprojection=True),
        controller("dash-tuned", dash_transport="h3"),
        controller("video"),
        controller("video", 3),
    }
    titles = [
        *("Seen", "Seen + reprojection + prediction auto", "Seen + scene", "mine"),
        *(
            "Profile 0",
            "Profile 3",
            "Profile 3 + scene",
            "Video Seen",
            "Video Profile 3",
            "DASH tuned",
            "DASH tuned + reprojection",
            "DASH tuned HTTP/3",
        ),
    ]
    assert [each.title for each in sort_controllers(some)] == titles
    assert controller("video").name == "video-seen"
    one = {"rung": 2, "bitrate_kbps": 900}
    assert controller("dash-edge", dash_transport="h3", dash_representation=one).name == "dash-edge-h3-r2-900"
    assert controller(upscale="scene").name == "seen+scene"
    assert controller(reprojection=True, prediction="auto").name == "seen+reprojection+prediction-auto"
    found = assign_looks(some)
    assert found[seen] == assign_looks([seen])[seen]
    assert len({(look.colour, look.dashes, look.marker) for look in found.values()}) == len(found)


@pytest.mark.parametrize("seen_as", SIGHTS, ids=list(SIGHTS))
def test_what_is_done_to_frames_is_told_apart_in_both_themes(seen_as: str) -> None:
    plain = Controller("stateless", "seen")
    stages = [
        plain,
        replace(plain, motion=("reprojection",)),
        replace(plain, enhancement="scene"),
        replace(plain, motion=("reprojection",), enhancement="scene"),
    ]
    found = assign_looks([*stages, Controller("stateless", 2), Controller("dash-tuned", None)])
    seen = [lab(SIGHTS[seen_as] @ linear(look.colour)) for look in found.values()]
    assert min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2)) > 15, "CIELAB; 2 is just noticeable"
    assert len({found[stage].dashes for stage in stages}) == len(stages)
    for stage in stages[1:]:
        for page in PAGES:
            assert contrast(found[stage].colour, page) > 3, "WCAG 2.2, 1.4.11"


def test_what_is_done_to_all_frames_sets_nothing_apart() -> None:
    plain = [Controller("stateless", "latency"), Controller("stateless", "seen"), Controller("stateless", 2)]
    turned = [replace(one, motion=("reprojection",)) for one in plain]
    assert list(assign_looks(turned).values()) == list(assign_looks(plain).values())
    both = assign_looks([*plain, *turned])
    assert len({(look.colour, look.dashes) for look in both.values()}) == len(both)
    assert len({(look.colour, look.marker) for look in both.values()}) == len(both)


def test_runs_are_called_by_what_tells_them_apart() -> None:
    two = [configuration("dash-tuned"), configuration(movement="walks/user3.csv")]
    assert list(run_names(two).values()) == [
        "DASH tuned, 20mbit,20ms-rtt, stroll",
        "Stateless seen, 20mbit,20ms-rtt, user3",
    ]
    assert list(run_names(two)) == [run.slug for run in two]
    many = [*two, configuration(scene="garden", segment=1, repeat=2)]
    assert list(run_names(many).values())[2] == "Stateless seen, 20mbit,20ms-rtt, stroll, garden, part 2, repeat 3"


def linear(colour: str) -> NDArray[np.float64]:
    values = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def lab(colour: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIELAB under D65 of linear sRGB."""
    white = np.array([0.95047, 1, 1.08883])
    xyz = TO_XYZ @ np.clip(colour, 0, 1) / white
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def contrast(a: str, b: str) -> float:
    dark, light = sorted(float(TO_XYZ[1] @ linear(colour)) for colour in (a, b))
    return (light + 0.05) / (dark + 0.05)
