"""Prints the number of GPUs visible to this process (CUDA_VISIBLE_DEVICES), without a context on any of them.

A separate program: the driver stays loaded in a process that has called it, and PyTorch would take seconds to
load.
"""

from __future__ import annotations

from cuda.bindings import driver

if __name__ == "__main__":
    driver.cuInit(0)
    _, count = driver.cuDeviceGetCount()  # none where the driver did not begin
    print(count or 0)
