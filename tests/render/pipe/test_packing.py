"""A field that is added to a model is packed without further code."""

from __future__ import annotations

from typing import Literal

import pytest
from pydantic import Field

from tests.render.fakes import render_request
from tigas_common.wire.model import WireModel
from tigas_common.wire.render import RenderRequest
from tigas_render.pipe.framing import BadMessage
from tigas_render.pipe.packing import Packing


class Extended(RenderRequest):
    """A RenderRequest with fields that it does not have today."""

    exposure: float | None = Field(default=None, gt=0)
    samples: int = 1
    corner: tuple[int, bool] | None = None


class Chosen(WireModel):
    """A text and a choice between two."""

    text: str
    choice: Literal["first", "second"] = "first"


EXTENDED = Packing(Extended)


@pytest.mark.parametrize(
    "added", [{}, {"exposure": 0.5, "samples": 4, "corner": (3, True)}, {"samples": -1, "corner": (0, False)}]
)
def test_added_fields_come_out_as_they_went_in(added: dict[str, float]) -> None:
    model = Extended(**vars(render_request()) | added)
    assert EXTENDED.unpack(EXTENDED.pack(model)) == model
    assert EXTENDED.unpack(b"head" + EXTENDED.pack(model), 4) == model


def test_an_unpacked_model_can_be_copied_and_dumped_like_any_other() -> None:
    model = EXTENDED.unpack(EXTENDED.pack(Extended(**vars(render_request()))))
    copy = model.model_copy(update={"samples": 2})
    assert (copy.samples, model.samples) == (2, 1)
    assert Extended.model_validate(copy.model_dump()) == copy


@pytest.mark.parametrize("content", [b"", b"\x02text", b"\x00\xff"])
def test_bytes_that_are_no_such_model_are_refused(content: bytes) -> None:
    with pytest.raises(BadMessage):
        Packing(Chosen).unpack(content)
