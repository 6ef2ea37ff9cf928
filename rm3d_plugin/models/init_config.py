"""How weights start, as mmengine's ``BaseModule`` takes it."""

from typing import Any

InitConfig = dict[str, Any] | list[dict[str, Any]] | None
