"""The page's shaders of one rung's network, run without a browser: through wgpu on Vulkan, Metal or Direct3D 12."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray
from wgpu.backends.wgpu_native import lib

from benchmarks.network_shaders import NetworkShaders, Precision

FORMAT = "rgba16float"


def open_device() -> wgpu.GPUDevice:
    """The fastest adapter's, with all that it can do of what is used here. Raises RuntimeError without any adapter."""
    adapter = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
    wanted = {"shader-f16", "timestamp-query"}
    return adapter.request_device_sync(required_features=sorted(wanted & set(adapter.features)))


class WgpuNetwork:
    """A network for frames of one size."""

    def __init__(
        self, device: wgpu.GPUDevice, shaders: NetworkShaders, precision: Precision, width: int, height: int
    ) -> None:
        self._device = device
        self._width, self._height = width, height
        self._scale = shaders.scale
        usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.STORAGE_BINDING
        self._frame = self._texture(
            (width, height, 1), "rgba8unorm", wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
        )
        activations = [self._texture((width, height, shaders.channels // 4), FORMAT, usage) for _ in range(2)]
        result_size = (width * shaders.scale, height * shaders.scale, 1)
        self._result = self._texture(result_size, FORMAT, usage | wgpu.TextureUsage.COPY_SRC)
        self._steps: list[tuple[Any, Any, int, int]] = []
        source = self._frame.create_view()
        layers = shaders.layers[precision]
        for i, layer in enumerate(layers):
            last = i == len(layers) - 1
            target = self._result.create_view() if last else activations[i % 2].create_view(dimension="2d-array")
            resources = [source, target, *([self._frame.create_view()] if last else [])]
            module = device.create_shader_module(code=layer.code)
            pipeline = device.create_compute_pipeline(layout="auto", compute={"module": module})
            bindings = device.create_bind_group(
                layout=pipeline.get_bind_group_layout(0),
                entries=[{"binding": binding, "resource": resource} for binding, resource in enumerate(resources)],
            )
            self._steps.append((pipeline, bindings, -(-width // layer.tile[0]), -(-height // layer.tile[1])))
            source = target

    def run(self, frame: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Of a frame [H, W, 3] the picture [r·H, r·W, 3], from 0 to 1."""
        pixels = np.dstack([frame, np.full((self._height, self._width), 255, np.uint8)])
        layout = {"bytes_per_row": 4 * self._width, "rows_per_image": self._height}
        size = (self._width, self._height, 1)
        self._device.queue.write_texture({"texture": self._frame}, pixels.tobytes(), layout, size)
        encoder = self._device.create_command_encoder()
        self._encode(encoder)
        self._device.queue.submit([encoder.finish()])
        width, height, _ = self._result.size
        layout = {"bytes_per_row": 8 * width, "rows_per_image": height}
        content = self._device.queue.read_texture({"texture": self._result}, layout, self._result.size)
        picture = np.frombuffer(content, np.float16).reshape(height, width, 4)
        return picture[..., :3].astype(np.float32)

    def times(self, frames: int) -> list[float]:
        """Milliseconds that the GPU takes for each of so many frames, one behind the other, by its own clock."""
        queries = self._device.create_query_set(type="timestamp", count=2 * frames)
        usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
        buffer = self._device.create_buffer(size=16 * frames, usage=usage)
        encoder = self._device.create_command_encoder()
        for i in range(frames):
            writes = {
                "query_set": queries,
                "beginning_of_pass_write_index": 2 * i,
                "end_of_pass_write_index": 2 * i + 1,
            }
            self._encode(encoder, timestamp_writes=writes)
        encoder.resolve_query_set(queries, 0, 2 * frames, buffer, 0)
        self._device.queue.submit([encoder.finish()])
        stamps = np.frombuffer(self._device.queue.read_buffer(buffer), np.uint64).reshape(frames, 2)
        # wgpu-py has no public name for it.
        period: float = lib.wgpuQueueGetTimestampPeriod(self._device.queue._internal)
        elapsed: list[float] = ((stamps[:, 1] - stamps[:, 0]) * period / 1e6).tolist()
        return elapsed

    def _encode(self, encoder: Any, **options: Any) -> None:
        compute = encoder.begin_compute_pass(**options)
        for pipeline, bindings, *workgroups in self._steps:
            compute.set_pipeline(pipeline)
            compute.set_bind_group(0, bindings)
            compute.dispatch_workgroups(*workgroups)
        compute.end()

    def _texture(self, size: Sequence[int], texture_format: str, usage: int) -> wgpu.GPUTexture:
        return self._device.create_texture(size=size, format=texture_format, usage=usage)
