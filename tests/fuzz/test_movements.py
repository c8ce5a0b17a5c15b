"""Any input as a movement, or as a recording, is read or refused in a sentence."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.byte_edits import edited
from tests.fuzz.fuzzers import assert_sentence, effort
from tigas_experiments.movement import eyenavgs
from tigas_experiments.movement.generated import KINDS, generate
from tigas_experiments.movement.summary import Summary
from tigas_experiments.movement.table import MovementError
from tigas_experiments.movement.trace import MovementTrace

OWN = (
    "# description: here\n# anchor: start\n# unit: m\nt_ms,x,y,z,qx,qy,qz,qw\n"
    "0,0,0,0,0,0,0,1\n20,0.5,0,0,0,0.7,0,0.7\n300,1,2,3,1,0,0,0\n"
)
NTHU = (
    "ViewIndex,timestep,PositionX,PositionY,PositionZ,QuaternionX,QuaternionY,QuaternionZ,QuaternionW\n"
    "0,0,0,1,2,0,0,0,1\n1,5,0.06,1,2,0,0,0,1\n0,11,0,1,2.1,0,0.1,0,0.99\n1,16,0.06,1,2.1,0,0.1,0,0.99\n"
)
RUTGERS = NTHU.replace("timestep", "Timestamp")
SETTINGS = 'Scene_Name,Scale,Quaternion\ntrain,1.5,"0,0,0,1"\nbike,2,"0,0.1,0,0.9"\n'
PIECES = (
    *(b",", b"\n", b"\r\n", b"\r", b'"', b"#", b"# anchor: scene\n"),
    *(b"# unit: scene\n", b"\0", b"\xff", b"\xef\xbb\xbf", b"\x85"),
    *(b"nan", b"inf", b"-1", b"1e308", b"1e-320", b"1e999", b"9" * 400),
    *(b"0", b"1_0", b"0x10", "٣".encode(), b"1e99", b"1e6"),
    *(b"t_ms", b"ViewIndex", b"x", b"\x1b[2J", b"y" * 11_000, b"0,0,0,0,0,0,0,0\n", b"86400001", b"\x1c", b"2"),
)  # fmt: skip

own, recordings = (
    edited(st.just(OWN.encode()), PIECES),
    edited(st.sampled_from([NTHU.encode(), RUTGERS.encode()]), PIECES),
)


Read = TypeVar("Read")


def read_from(content: bytes, read: Callable[[Path], Read], name: str = "m.csv") -> Read | None:
    """A file's contents, unless it is refused in a sentence."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        try:
            return read(path)
        except MovementError as error:
            assert_sentence(str(error))
            return None


def assert_sound(movement: MovementTrace) -> None:
    """It can be played, and written and read again."""
    assert movement.times_ms[0] == 0
    assert np.isfinite(movement.positions).all()
    assert np.allclose(np.linalg.norm(movement.quaternions, axis=1), 1)
    _, turned = movement.poses_at([-1.0, 0.0, movement.duration_ms / 3, movement.duration_ms, 1e9])
    assert np.isfinite(turned).all()
    Summary.from_trace(movement)
    again = MovementTrace.parse(movement.to_csv(), "again")
    assert again.anchor == movement.anchor


@effort(150)
@given(own | recordings)
def test_any_file_is_a_movement_or_one_sentence(content: bytes) -> None:
    if (movement := read_from(content, MovementTrace.read)) is not None:
        assert_sound(movement)


@effort(150)
@given(recordings | own, st.sampled_from(["left", "right", "middle"]))
def test_any_recording_of_eyes_is_imported_or_refused(content: bytes, eye: eyenavgs.Eye) -> None:
    way = read_from(content, lambda path: eyenavgs.read_eyes(path, eye), "user3_train.csv")
    if way is not None:
        assert_sound(eyenavgs.to_recorded_scene(way, (0, -1, 0)))


@effort()
@given(edited(st.just(SETTINGS.encode()), PIECES))
def test_any_table_of_scenes_is_read_or_refused(content: bytes) -> None:
    settings = read_from(content, lambda path: eyenavgs.read_settings(path, "train"))
    assert settings is None or settings.scale > 0


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_any_seed_makes_a_movement(kind: str) -> None:
    @effort(10)
    @given(st.integers(0, 2**63), st.floats(1, 60))
    def fuzz(seed: int, seconds: float) -> None:
        assert_sound(generate(kind, seconds, seed))

    fuzz()
