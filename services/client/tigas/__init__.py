"""Client of a TIGAS render service: send a pose, get an image (docs/python.md).

```python
with tigas.Client("http://localhost:8080") as client:
    client.render(client.start_pose()).save("view.png")
```
"""

from tigas.async_client import AsyncClient
from tigas.client import Client
from tigas.errors import ClientError, Refused, Unreachable
from tigas.frame import Frame, View
from tigas.notebook import show
from tigas_common.pose import Intrinsics, Pose

__all__ = [
    "AsyncClient",
    "Client",
    "ClientError",
    "Frame",
    "Intrinsics",
    "Pose",
    "Refused",
    "Unreachable",
    "View",
    "show",
]
