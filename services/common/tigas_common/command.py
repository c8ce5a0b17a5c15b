"""Commands with options from the fields of a model, which are also settings keys and environment variables."""

from __future__ import annotations

import argparse
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, NamedTuple, NoReturn, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

from tigas_common.errors import UsageError

Model = TypeVar("Model", bound=BaseModel)


class Metavar(NamedTuple):
    """Marker of a field: the placeholder for its value in --help."""

    text: str


NO_FLAG: Final = "no flag"
"""Marker of a setting that only the settings file and the environment can set."""
POSITIONAL: Final = "positional"
"""Marker of a field given by position rather than by flag."""
REST: Final = "rest"
"""Marker of a list that takes all arguments after `--` or after the positional ones, including options."""


class Command(BaseModel, ABC):
    """A command of `tigas`. The docstrings of the class and its fields are the text of --help."""

    model_config = SettingsConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    @abstractmethod
    def run(self) -> None:
        """Execute the command."""


@dataclass(frozen=True)
class Group:
    help: str
    commands: Mapping[str, type[Command]]
    default: str | None = None
    """The command to run if none is named."""

    def select(self, prog: str, arguments: Sequence[str]) -> tuple[type[Command], str, Sequence[str]]:
        """The requested command, its full name and its arguments. Prints help and exits on request."""
        name, *more = arguments or ["--help"]
        if name in ("-h", "--help"):
            summaries = {name: summary(command) for name, command in self.commands.items()}
            print(list_commands(prog, self.help, summaries))
            raise SystemExit(0 if arguments else 2)
        if name not in self.commands and self.default is not None:
            name, more = self.default, list(arguments)
        if name not in self.commands:
            raise UsageError(f"{prog} has no command {name!r}; `{prog} --help` lists them.")
        return self.commands[name], f"{prog} {name}", more


def summary(command: Group | type[Command]) -> str:
    return (command.help if isinstance(command, Group) else cleandoc(command.__doc__ or "")).partition("\n")[0]


def list_commands(prog: str, help: str, summaries: Mapping[str, str]) -> str:
    """The text of --help for a group of commands."""
    width = 3 + max(map(len, summaries))
    lines = [f"  {name:{width}}{text}" for name, text in summaries.items()]
    return "\n".join([f"usage: {prog} COMMAND …", "", help, "", "commands:", *lines])


def parse(model: type[Model], prog: str, arguments: Sequence[str]) -> Model:
    """Parse a command line into a model. Raises UsageError with one sentence; prints help and exits on request."""
    fields = dict(parameters(model))
    rest = next((name for name, field in fields.items() if REST in field.metadata), None)
    tail: Sequence[str] = ()
    if rest:
        arguments, tail = _split(arguments, sum(POSITIONAL in field.metadata for field in fields.values()))
    values = vars(_parser(model, prog).parse_intermixed_args(arguments))
    return load(model, values | ({rest: list(tail)} if rest and tail else {}))


def load(model: type[Model], values: Mapping[str, Any]) -> Model:
    """Build a model from these values, and settings also from file and environment. Raises UsageError."""
    try:
        return model(**values)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        loc = list(map(str, first["loc"]))
        if first["type"] == "missing" and len(loc) == 1:
            raise UsageError(f"{_name(loc[0], model.model_fields[loc[0]])} is missing.") from None
        problem = "unknown setting" if first["type"] == "extra_forbidden" else first["msg"]
        raise UsageError(f"{_place(model, loc, values)}: {problem.removeprefix('Value error, ')}") from None
    except SettingsError as error:
        _, name, *_ = str(error).split('"')
        raise UsageError(f"{_variable(model, name)} is not JSON: {error.__cause__}") from None


def parameters(model: type[BaseModel]) -> Iterator[tuple[str, FieldInfo]]:
    """The fields that a command line can set: all except nested models and fields marked NO_FLAG."""
    for name, field in model.model_fields.items():
        nested = isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)
        if NO_FLAG not in field.metadata and not nested:
            yield name, field


class _Parser(argparse.ArgumentParser):
    """A parser that reports an invalid command line in one sentence."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; `{self.prog} --help` lists the options.")


def _parser(model: type[BaseModel], prog: str) -> _Parser:
    parser = _Parser(
        prog=prog,
        description=cleandoc(model.__doc__ or ""),
        epilog=_epilog(model),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
        allow_abbrev=False,
    )
    defaults: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        if not field.is_required():
            defaults[name] = field.get_default(call_default_factory=True, validated_data=defaults)
    for name, field in parameters(model):
        text = _help(model, name, field, defaults.get(name)).replace("%", "%%")
        several = _is_several(field)
        if REST in field.metadata:
            metavar = _metavar(field.annotation, field.metadata) or name.upper()
            parser.epilog = "\n\n".join(filter(None, (f"{metavar}: {text}", parser.epilog)))
            fixed = [
                _metavar(None, its.metadata) or n.upper() for n, its in parameters(model) if POSITIONAL in its.metadata
            ]
            parser.usage = " ".join((prog, "[options]", *fixed, "--", metavar))
        elif POSITIONAL in field.metadata:
            nargs = ("+" if field.is_required() else "*") if several else None if field.is_required() else "?"
            parser.add_argument(name, nargs=nargs, metavar=_metavar(None, field.metadata) or name.upper(), help=text)
        elif bool in _alternatives(field.annotation):
            flag = issubclass(model, BaseSettings)  # a flag may override file or environment
            action: Any = argparse.BooleanOptionalAction if flag else "store_true"
            parser.add_argument(_name(name, field), dest=name, action=action, help=text)
        else:
            parser.add_argument(
                _name(name, field),
                dest=name,
                action="append" if several else "store",
                metavar=_metavar(field.annotation, field.metadata) or "TEXT",
                help=text,
            )
    return parser


def _split(arguments: Sequence[str], positional: int) -> tuple[Sequence[str], Sequence[str]]:
    """Split a command's own arguments from the rest."""
    if positional:
        head, tail = arguments[:positional], arguments[positional:]
        return head, tail[1:] if tail[:1] == ["--"] else tail
    end = list(arguments).index("--") if "--" in arguments else len(arguments)
    return arguments[:end], arguments[end + 1 :]


def _name(name: str, field: FieldInfo) -> str:
    """A parameter as the user types it; repeatable flags are in the singular."""
    if POSITIONAL in field.metadata or REST in field.metadata:
        return name.upper()
    return "--" + (name.removesuffix("s") if _is_several(field) else name.removesuffix("_")).replace("_", "-")


def _variable(model: type[BaseModel], name: str) -> str:
    """The environment variable of a setting."""
    return f"{model.model_config.get('env_prefix', '')}{name}".upper()


def _place(model: type[BaseModel], loc: Sequence[str], values: Mapping[str, Any]) -> str:
    """Where a value came from: a flag, an environment variable or a key in the settings file."""
    name, *keys = loc
    if name in values:
        return _name(name, model.model_fields[name])
    if (variable := _variable(model, name)) in os.environ:
        return ".".join([variable, *keys])
    return f"[{getattr(model, 'table', '')}] {'.'.join(loc)}"


def _help(model: type[BaseModel], name: str, field: FieldInfo, default: Any) -> str:
    notes = []
    if isinstance(default, tuple | list):
        default = ",".join(map(str, default))
    if default not in (None, False, ""):
        notes.append(f"default: {default:g}" if isinstance(default, float) else f"default: {default}")
    if issubclass(model, BaseSettings):
        notes.append(_variable(model, name))
    text = " ".join((field.description or "").split())
    if _is_several(field) and POSITIONAL not in field.metadata and REST not in field.metadata:
        text += " Repeatable."
    return f"{text} [{'; '.join(notes)}]" if notes else text


def _epilog(model: type[BaseModel]) -> str | None:
    if not issubclass(model, BaseSettings):
        return None
    return (
        f"Settings are also read from the table `{getattr(model, 'table', '')}` of tigas.toml, or of the file in\n"
        "TIGAS_CONFIG, and from the environment variables in brackets."
    )


def _metavar(annotation: Any, metadata: Sequence[Any] = ()) -> str | None:
    """The placeholder for a value in --help; None if neither a marker nor the type defines one."""
    if found := next((each.text for each in metadata if isinstance(each, Metavar)), None):
        return found
    if get_origin(annotation) is Annotated:
        return _metavar(annotation.__origin__, annotation.__metadata__)
    for each in _alternatives(annotation):
        if get_origin(each) is Literal:
            return "|".join(map(str, get_args(each)))
        if get_origin(each) in (tuple, list, Annotated):
            return _metavar(each if get_origin(each) is Annotated else get_args(each)[0])
    return {int: "N", float: "NUMBER", Path: "PATH"}.get(_alternatives(annotation)[0])


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    if get_origin(annotation) in (Union, UnionType):
        return tuple(each for each in get_args(annotation) if each is not NoneType)
    return (annotation,)


def _is_several(field: FieldInfo) -> bool:
    return any(get_origin(each) in (tuple, list) for each in _alternatives(field.annotation))
