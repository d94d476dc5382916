"""A recording as one page of HTML that is self-contained: no script, no request to any host.

html      elements, with all texts escaped
sketch    small curves as SVG
outcome   damage, timing, measures of stages, energy balance, audit
devices   controllers and sensors
account   events, values, provenance, notes, commands
style     its style
page      the page: its sections in order
"""

from __future__ import annotations

from rig.analysis.report.page import page, write

__all__ = ["page", "write"]
