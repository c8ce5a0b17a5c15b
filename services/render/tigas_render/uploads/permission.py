"""Whether pages may bring files of scenes, and change the scenes that are there."""

from __future__ import annotations

import os

from tigas_common.errors import TigasError
from tigas_render.settings import RenderSettings
from tigas_render.uploads.parts import Uploads


class ScenesFixed(TigasError):
    """Pages may not change this service's scenes."""

    status, type, title = 403, "scenes-fixed", "Scenes cannot be changed here"


def open_uploads(settings: RenderSettings) -> Uploads:
    """The uploads to the models directory, if pages may change it. Raises ScenesFixed."""
    if not settings.pages_edit_scenes:
        raise ScenesFixed("Pages may not change this service's scenes; outside a cluster, --edit-scenes lets them.")
    if not os.access(settings.scenes, os.W_OK | os.X_OK):
        raise ScenesFixed("The service may not write to its models directory.")
    return Uploads(settings.scenes, limit=int(settings.memory_gb * 1e9))
