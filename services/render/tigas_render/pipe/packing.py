"""A fixed binary form of a wire model, derived from the annotations of its fields.

Packing and unpacking run for every request, so both are compiled once from the annotations, as `dataclasses` does.
"""

from __future__ import annotations

import struct
from types import UnionType
from typing import Annotated, Any, Generic, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

from tigas_common.wire.model import WireModel
from tigas_render.pipe.link import BadMessage

Model = TypeVar("Model", bound=WireModel)
_CODES = {bool: "?", int: "q", float: "d"}


class _Part(NamedTuple):
    """The binary form of one value, and the Python expressions that pack and unpack it."""

    codes: str
    """In the language of `struct`."""
    packed: str
    unpacked: str


class Packing(Generic[Model]):
    """The binary form of a model that starts with a text field: the other fields as a struct, then the text.

    The struct's numbers are `_0`, `_1`, … while it is unpacked.
    """

    def __init__(self, model: type[Model]) -> None:
        self._count = 0
        self._constants: dict[str, Any] = {"trusted": model.trusted}
        text, *fields = model.model_fields
        parts = {name: self._part(model.model_fields[name].annotation, name) for name in fields}
        self._layout = struct.Struct("<" + "".join(part.codes for part in parts.values()))
        self._constants["pack"] = self._layout.pack
        packed = ", ".join(part.packed for part in parts.values())
        self._pack = self._compiled(f"lambda {text}, {', '.join(fields)}: pack({packed}) + {text}.encode()")
        numbers = ", ".join(f"_{number}" for number in range(self._count))
        unpacked = ", ".join(f"{name!r}: {part.unpacked}" for name, part in parts.items())
        self._unpack = self._compiled(f"lambda {text}, {numbers}: trusted({{{text!r}: {text}, {unpacked}}})")

    def pack(self, model: Model) -> bytes:
        """The binary form of a valid model."""
        packed: bytes = self._pack(*vars(model).values())  # pydantic keeps them in the order of the fields
        return packed

    def unpack(self, content: bytes, begin: int = 0) -> Model:
        """The model from the bytes that begin there. Its values have the right types, but their limits are not checked.

        Raises BadMessage.
        """
        try:
            text = content[begin + self._layout.size :].decode()
            model: Model = self._unpack(text, *self._layout.unpack_from(content, begin))
        except (struct.error, UnicodeDecodeError, IndexError):
            raise BadMessage("A message does not have the fields that it should have.") from None
        return model

    def _part(self, annotation: Any, value: str) -> _Part:
        """The next value, which has this type and comes from this expression."""
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            return self._part(arguments[0], value)
        if origin in (Union, UnionType):
            (type_if_present,) = (each for each in arguments if each is not type(None))
            is_present = self._number()
            part = self._part(type_if_present, value)
            absent = (False,) + (0,) * len(part.codes)
            packed = f"*({absent} if {value} is None else (True, {part.packed}))"
            return _Part(f"?{part.codes}", packed, f"({part.unpacked} if {is_present} else None)")
        if origin is tuple:
            parts = [self._part(each, "") for each in arguments]
            unpacked = ", ".join(part.unpacked for part in parts)
            return _Part("".join(part.codes for part in parts), f"*{value}", f"({unpacked},)")
        if origin is Literal:
            numbers = self._constant({choice: number for number, choice in enumerate(arguments)})
            return _Part("B", f"{numbers}[{value}]", f"{self._constant(arguments)}[{self._number()}]")
        if annotation in _CODES:
            return _Part(_CODES[annotation], value, self._number())
        fields = {
            name: self._part(field.annotation, f"{value}.{name}") for name, field in annotation.model_fields.items()
        }
        unpacked = ", ".join(f"{name!r}: {part.unpacked}" for name, part in fields.items())
        return _Part(
            "".join(part.codes for part in fields.values()),
            ", ".join(part.packed for part in fields.values()),
            f"{self._constant(annotation.trusted)}({{{unpacked}}})",
        )

    def _number(self) -> str:
        self._count += 1
        return f"_{self._count - 1}"

    def _constant(self, value: object) -> str:
        name = f"constant_{len(self._constants)}"
        self._constants[name] = value
        return name

    def _compiled(self, source: str) -> Any:
        return eval(source, self._constants)
