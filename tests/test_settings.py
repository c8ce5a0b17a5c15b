"""Every service's settings: no number is infinite or none."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

from tigas_cluster.settings import ClusterSettings
from tigas_common.settings import ServiceSettings
from tigas_dash.settings import DashSettings
from tigas_experiments.store.settings import StoreSettings
from tigas_render.settings import RenderSettings
from tigas_shaper.settings import ShaperSettings

SERVICES = (ClusterSettings, RenderSettings, DashSettings, ShaperSettings, StoreSettings)


def numbers(model: type[BaseModel]) -> Iterator[tuple[type[BaseModel], str]]:
    """Every field of a model that is a number, and of the models in it."""
    for name, field in model.model_fields.items():
        if field.annotation is float:
            yield model, name
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from numbers(field.annotation)


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1e999"])
@pytest.mark.parametrize("settings", SERVICES)
def test_every_number_is_finite(settings: type[ServiceSettings], value: str) -> None:
    found = list(numbers(settings))
    assert found
    for model, name in found:
        with pytest.raises(ValidationError) as refused:
            TypeAdapter(model).validate_python({name: value})
        assert any(error["loc"] == (name,) for error in refused.value.errors()), name
