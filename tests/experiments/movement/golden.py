"""Source of `golden.json`: `python -m tests.experiments.movement.golden` writes it.

Both readers and placers of movements are tested against it, the lab's (Python) and the page's (TypeScript). A
quaternion and its negative are the same rotation.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.scenes import scene
from tigas_common.wire.render import StartCamera
from tigas_experiments.movement.trace import MovementTrace, place_in_scene

FILE = Path(__file__).with_name("golden.json")
HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
POSE = "0,1,2,3,0,0,0,1\n"
ROWS = (
    "0,0,0,0,0,0,0,1\n"
    "100.5,0.1,0,0.25,0,0.130526,0,0.991445\n"
    "180,-0.4,0.05,1.5,0.1,-0.2,0.3,0.927362\n"
    "1000,2,-0.5,-1,0.5,0.5,0.5,0.5\n"
)
MOVEMENTS = {
    "start, metres": f"# anchor: start\n# unit: m\n{HEADER}{ROWS}",
    "start, the scene's unit": f"# anchor: start\n{HEADER}{ROWS}",
    "start, the scene's unit, said so": (
        f"# description: a: b, c\n#unit:scene\n# remark\n# anchor: start\n{HEADER}{ROWS}"
    ),
    "scene": f"# anchor: scene\n{HEADER}{ROWS}",
    "nothing said, with another system's ends of lines": (HEADER + ROWS).replace("\n", "\r\n"),
    "other columns in another order, later": (
        "qw,gaze,qz,qy,qx,z,y,x,t_ms\n1,?,0,0,0,3,2,1,5000\n0.5,,0.5,0.5,0.5,6,5,4,5500\n"
    ),
    "quaternions of other lengths": f"{HEADER}0,1,2,3,0,0,0,2\n50,1,2,3,0,0.3,0,0.4\n99,1,2,3,0,0.6004,0,0.8\n",
    "times that repeat; remarks and blank lines among the rows": (
        f"# anchor: start\n# unit: m\n\n{HEADER}{POSE}\n# anchor: scene\n0,9,9,9,0,0,0,1\n"
        "20,2,2,3,0,0,0,1\n20,9,9,9,0,0,0,1\n"
    ),
    "a pose alone": f"{HEADER}{POSE}",
}
"""Texts that are movements."""
REFUSED = {
    "nothing": "",
    "blank lines": "\n\n",
    "comments alone": "# anchor: start\n",
    "a header alone": HEADER,
    "a column is missing": "t_ms,x,y,z,qx,qy,qz\n0,1,2,3,0,0,0\n",
    "a column twice": "t_ms,x,x,y,z,qx,qy,qz,qw\n0,1,1,2,3,0,0,0,1\n",
    "other columns": "time,x\n0,1\n",
    "the end of a line within the header": HEADER.replace("z,", "z\r", 1) + POSE,
    "a header in quotation marks": HEADER.replace("x", '"x"', 1) + POSE,
    "an anchor that is none": f"# anchor: moon\n{HEADER}{POSE}",
    "a unit that is none": f"# anchor: start\n# unit: feet\n{HEADER}{POSE}",
    "metres in a scene's own frame": f"# anchor: scene\n# unit: m\n{HEADER}{POSE}",
    "metres without an anchor": f"# unit: m\n{HEADER}{POSE}",
    "NaN": f"{HEADER}0,1,2,nan,0,0,0,1\n",
    "infinite": f"{HEADER}0,1,2,inf,0,0,0,1\n",
    "too large for a number": f"{HEADER}0,1,2,1e999,0,0,0,1\n",
    "a word": f"{HEADER}0,1,2,three,0,0,0,1\n",
    "an empty cell": f"{HEADER}0,1,2,,0,0,0,1\n",
    "a row cut short": f"{HEADER}{POSE}20,1,2\n",
    "time runs back": f"{HEADER}{POSE}20,1,2,3,0,0,0,1\n10,1,2,3,0,0,0,1\n",
    "a quaternion of length zero": f"{HEADER}0,1,2,3,0,0,0,0\n",
    "a quaternion far too short": f"{HEADER}0,1,2,3,0,0,0,0.05\n",
    "a quaternion far too long": f"{HEADER}0,1,2,3,0,0,0,20\n",
    "farther away than a million": f"{HEADER}0,1,-2000000,3,0,0,0,1\n",
    "longer than a day": f"{HEADER}{POSE}90000000,1,2,3,0,0,0,1\n",
}
"""Invalid texts."""
COURTYARD = StartCamera(position=(-0.9, -1.75, -9.7), look_at=(0.35, -1.75, 0.0))
SCENES = {
    "y down": scene(camera=COURTYARD),
    "y down, no camera": scene(),
    "y down, the camera looks straight down": scene(camera=StartCamera(position=(1, -5, 2), look_at=(1, 0, 2))),
    "y up": scene(up=(0, 1, 0), camera=StartCamera(position=(0.5, 1.5, 4), look_at=(0, 1, 0))),
    "y up, no camera": scene(up=(0, 1, 0)),
    "z up": scene(up=(0, 0, 1), camera=StartCamera(position=(2, -1, 1.5), look_at=(0, 0, 0.5))),
    "tilted, up not of length one": scene(
        up=(0.6, -1.8, 0.4), camera=StartCamera(position=(3, 1, -2), look_at=(-1, 0.5, 2))
    ),
    "tilted, no camera": scene(up=(0.6, -1.8, 0.4)),
}


def golden() -> dict[str, Any]:
    return {
        "movements": MOVEMENTS,
        "refused": REFUSED,
        "scenes": {name: info.model_dump(mode="json", include={"up", "camera"}) for name, info in SCENES.items()},
        "placed": [
            {"movement": movement, "scene": name, "points": place_in_scene(MovementTrace.parse(text, movement), info)}
            for movement, text in MOVEMENTS.items()
            for name, info in SCENES.items()
        ],
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(golden(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
