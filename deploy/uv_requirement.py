"""Print uv's entry in uv.lock as a requirement with hashes, for `pip install --require-hashes`."""

import tomllib
from pathlib import Path

lock = tomllib.loads((Path(__file__).parents[1] / "uv.lock").read_text())
uv = next(package for package in lock["package"] if package["name"] == "uv")
print(f"uv=={uv['version']}", *(f"--hash={wheel['hash']}" for wheel in uv["wheels"]))
