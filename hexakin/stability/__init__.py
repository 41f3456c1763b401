"""Support polygon, zero-moment point and stability margins; margins of any contacts; the support region."""

from hexakin.stability.polygon import centroid, margin, polygon_margins, support_polygon
from hexakin.stability.time_series import ZMP, StabilitySeries, series, static_margin, zero_moment_point, zmp

__all__ = [
    "ZMP", "StabilitySeries", "centroid", "margin", "polygon_margins", "series", "static_margin", "support_polygon",
    "zero_moment_point", "zmp",
]  # fmt: skip
