"""The figure of a cost table: what stands on its axes can be read."""

from itertools import pairwise

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.qualify.cost import report


@pytest.mark.parametrize(("low", "ratio"), [(0.02, 1.5), (0.0003, 99.0), (3.3, 101.0), (3000.0, 1e6)])
def test_labels_of_the_two_horizontal_axes_stay_apart(ratio, low):
    with mpl.rc_context(report.STYLE):
        sheet = Figure(figsize=(10.8, 6.4), dpi=125, layout="constrained")
        canvas = FigureCanvasAgg(sheet)
        for axes, converted in zip(sheet.subplots(1, 2), (report.percent_of_frame, report.real_time_factor)):
            axes.set(xscale="log", xlim=(low, low * ratio))
            report.second_axis(axes, converted, "share of a frame [%]")
        canvas.draw()
        for axes in sheet.axes:
            begin, end = sorted(axes.get_xlim())
            ticks = [*axes.xaxis.get_major_ticks(), *axes.xaxis.get_minor_ticks()]
            texts = [text for tick in ticks for text in (tick.label1, tick.label2) if begin <= tick.get_loc() <= end]
            seen = [text for text in texts if text.get_visible() and text.get_text()]
            boxes = sorted((box.x0, box.x1) for box in (text.get_window_extent() for text in seen))
            assert all(left[1] < right[0] for left, right in pairwise(boxes))
            assert boxes
