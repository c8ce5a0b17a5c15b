"""What is compared: its names, and how it is drawn."""

from __future__ import annotations

import json
from pathlib import Path

from tigas_common.wire.run import Configuration, Mode
from tigas_experiments.report.controllers import (
    FIXED_COLOUR,
    KNOWN_LOOKS,
    OTHER_COLOURS,
    Controller,
    in_order,
    looks,
)

IN_THE_PAGE = Path(__file__).parents[3] / "web/src/experiment/looks.json"


def test_the_page_has_the_colours_of_reports() -> None:
    colours = {name: look.colour for name, look in KNOWN_LOOKS.items()}
    expected = {"known": colours, "others": list(OTHER_COLOURS), "fixed": FIXED_COLOUR}
    assert json.loads(IN_THE_PAGE.read_text()) == expected


def test_a_controller_looks_the_same_in_every_report() -> None:
    def controller(
        mode: Mode = "stateless", profile: int | str = "budget", upscale: str = "off", **more: object
    ) -> Controller:
        return Controller.of(
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

    budget, mine = controller(), controller(profile="mine")
    some = {
        budget,
        controller("dash-tuned"),
        controller("dash-tuned", "latency"),
        mine,
        controller(profile=3),
        controller(profile=3, upscale="scene"),
        controller(upscale="scene"),
        controller(profile=0),
        controller(reprojection=True, prediction="auto"),
        controller("dash-tuned", reprojection=True),
        controller("video"),
        controller("video", 3),
    }
    titles = [
        *("Budget", "Budget + reprojection + prediction auto", "Budget + scene", "mine"),
        *(
            "Profile 0",
            "Profile 3",
            "Profile 3 + scene",
            "Video Budget",
            "Video Profile 3",
            "DASH tuned",
            "DASH tuned + reprojection",
        ),
    ]
    assert [each.title for each in in_order(some)] == titles
    assert controller("video").name == "video-budget"
    assert controller(upscale="scene").name == "budget+scene"
    assert controller(reprojection=True, prediction="auto").name == "budget+reprojection+prediction-auto"
    found = looks(some)
    assert found[budget] == looks([budget])[budget]
    assert len({(look.colour, look.dashes, look.marker) for look in found.values()}) == len(found)
