"""Room for frames is given once, taken back once, and never lost."""

from __future__ import annotations

import os
from contextlib import closing

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from tigas_render.pipe.arena import ALIGNMENT, Arena, map_arena

SIZE = 40 * ALIGNMENT


def test_what_the_engine_writes_is_what_the_edge_reads() -> None:
    with closing(Arena(SIZE)) as arena:
        view = map_arena(os.dup(arena.fd))
        first, second = arena.write(b"first"), arena.write(memoryview(b"second"))
        assert first is not None
        assert second is not None
        assert bytes(view[first : first + 5]) == b"first"
        assert bytes(view[second : second + 6]) == b"second"
        with pytest.raises(TypeError, match="read-only"):
            view[0] = 1


def test_the_edge_cannot_shrink_what_the_engine_writes_to() -> None:
    with closing(Arena(SIZE)) as arena, pytest.raises(PermissionError):
        os.ftruncate(arena.fd, 0)


def test_a_full_arena_says_so_until_something_is_freed() -> None:
    with closing(Arena(SIZE)) as arena:
        assert arena.write(bytes(SIZE)) == 0
        assert arena.write(b"") is None
        arena.free(0)
        with pytest.raises(KeyError):
            arena.free(0)
        assert arena.used_bytes == 0
        assert arena.write(bytes(SIZE + 1)) is None


class ArenaMachine(RuleBasedStateMachine):
    """Frames are written and freed in any order."""

    frames = Bundle("frames")

    def __init__(self) -> None:
        super().__init__()
        self.arena = Arena(SIZE)
        self.view = map_arena(os.dup(self.arena.fd))
        self.bodies: dict[int, bytes] = {}

    @rule(target=frames, length=st.integers(0, 12 * ALIGNMENT), fill=st.integers(1, 255))
    def write(self, length: int, fill: int) -> int | None:
        body = bytes((fill,)) * length
        offset = self.arena.write(body)
        if offset is not None:
            assert offset not in self.bodies
            self.bodies[offset] = body
        return offset

    @rule(offset=consumes(frames))
    def free(self, offset: int | None) -> None:
        if offset is not None:
            self.arena.free(offset)
            del self.bodies[offset]

    @invariant()
    def no_frame_was_overwritten(self) -> None:
        for offset, body in self.bodies.items():
            assert self.view[offset : offset + len(body)] == body

    def teardown(self) -> None:
        for offset in self.bodies:
            self.arena.free(offset)
        assert self.arena.write(bytes(SIZE)) == 0, "what was freed is one piece again"
        self.arena.close()


TestArena = ArenaMachine.TestCase
