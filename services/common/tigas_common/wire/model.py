"""Basis of all wire models: the base class, coordinates, and limits on image sizes."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Self, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

MAX_SIDE = 8192
"""Maximum side length of a viewport or frame, in pixels."""
MAX_PIXELS = 16_777_216
"""Maximum number of pixels in a viewport or frame."""

Angle = Annotated[float, Field(ge=-1e6, le=1e6)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Unit = Annotated[float, Field(ge=0, le=1)]

Entry = TypeVar("Entry")
Entries = Annotated[tuple[Entry, ...], Field(fail_fast=True)]
"""A tuple of any length. Validation stops at the first invalid entry, as a megabyte can hold a million."""


def _is_rotation(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("a quaternion of length zero is not a rotation")
    return quaternion


Quaternion = Annotated[tuple[Coordinate, Coordinate, Coordinate, Coordinate], AfterValidator(_is_rotation)]
"""[x, y, z, w], of any length but zero."""


class WireModel(BaseModel):
    """Immutable model that rejects unknown fields, NaN, infinities and values of another type."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @classmethod
    def trusted(cls, fields: dict[str, Any]) -> Self:
        """Create a model from values already validated by another of our processes, one for each field.

        For thousands of models a second: much faster than pydantic's constructors, including `model_construct`.
        """
        model = cls.__new__(cls)
        object.__setattr__(model, "__dict__", fields)
        object.__setattr__(model, "__pydantic_fields_set__", _all_fields(cls))
        object.__setattr__(model, "__pydantic_extra__", None)
        object.__setattr__(model, "__pydantic_private__", None)
        return model


@cache
def _all_fields(model: type[WireModel]) -> set[str]:
    """The names of a model's fields, shared by all its trusted instances, as the set never changes."""
    return set(model.model_fields)
