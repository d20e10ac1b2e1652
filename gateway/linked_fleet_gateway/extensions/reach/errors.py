"""Errors of the action ``reach``.

``OutOfReach`` (422, out-of-reach).
"""

from linked_fleet_gateway.base.errors import Members, UnprocessableContent


class OutOfReach(UnprocessableContent):
    """No joint positions reach the pose; the residuals are in m and rad (0 without a target orientation)."""

    code, title = "out-of-reach", "The pose cannot be reached"

    def __init__(self, detail: str, *, residual_m: float, residual_rad: float) -> None:
        super().__init__(detail)
        self.residual_m, self.residual_rad = residual_m, residual_rad

    @property
    def members(self) -> Members:
        return super().members | {"residual_m": self.residual_m, "residual_rad": self.residual_rad}
