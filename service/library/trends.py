"""The trend of a robot's joints as people hold it: alarms in words, a table, a chart of each joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from jointstiff.schemas.trend import Trend
from jointstiff.service.library.results import Presented
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS
from jointstiff.service.tables.table import NO_NUMBER, Chart, Line, Part, Sheet, figure, text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class RobotTrend(Presented, Trend):
    """Stiffness of a robot's joints over its campaigns, with alarms; it shows itself."""

    def _parts(self) -> Sequence[Part]:
        states = [joint.state for joint in self.joints]
        alarms = [alarm.message for joint in self.joints for alarm in joint.alarms if alarm.until is None]
        head = f"{len(self.campaigns)} campaigns: {states.count('alarm')} of {len(states)} joints in alarm"
        rows = []
        for joint in self.joints:
            change = joint.latest if joint.pair is None else joint.pair.change
            shown = NO_NUMBER
            if change is not None:
                size, u = (
                    figure(100 * each, ".2g") for each in (change.relative, change.standard_uncertainty)
                )
                shown = f"{size} ± {u} %"
            rows.append([joint.name, joint.state.replace("_", " "), shown])
        lines = [Line(head), *map(Line, alarms), *([Line(self.note)] if self.note else [])]
        return [*lines, text_table(["joint", "state", "latest change, ± u"], rows, texts=[0, 1])]

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        return {"points": self._points}

    def _points(self) -> Sheet:
        """Return a row for each joint and campaign, in SI units."""
        pairs = [
            (joint, campaign, point)
            for joint in self.joints
            for campaign, point in zip(self.campaigns, joint.points, strict=True)
        ]
        limits = [point.interval or (None, None) for _, _, point in pairs]
        columns = {
            "joint": [joint.name for joint, _, _ in pairs],
            "campaign": [campaign.name for _, campaign, _ in pairs],
            "at": [campaign.at.isoformat() for _, campaign, _ in pairs],
            "stiffness [N.m/rad]": [point.stiffness for _, _, point in pairs],
            "lower [N.m/rad]": [low for low, _ in limits],
            "upper [N.m/rad]": [high for _, high in limits],
            "EWMA [N.m/rad]": [point.smoothed for _, _, point in pairs],
            "lower limit [N.m/rad]": [point.lower_limit for _, _, point in pairs],
            "upper limit [N.m/rad]": [point.upper_limit for _, _, point in pairs],
        }
        sheet = Sheet(columns, frozenset(["joint", "campaign", "at"]))
        return Sheet.of_joints(sheet, [joint.kind for joint, _, _ in pairs])

    def _figure(self) -> Figure:
        from jointstiff.service.reports.plots import figure_of

        names = [f"{campaign.at:%Y-%m-%d}" for campaign in self.campaigns]
        charts = []
        for joint in self.joints:
            unit = UNITS[DEFAULT_UNIT].of(joint.kind)
            series = {
                "stiffness": [point.stiffness for point in joint.points],
                "EWMA": [point.smoothed for point in joint.points],
                "lower limit": [point.lower_limit for point in joint.points],
                "upper limit": [point.upper_limit for point in joint.points],
            }
            ends = {"stiffness": [point.interval for point in joint.points]}
            known = {name: values for name, values in series.items() if any(v is not None for v in values)}
            title = f"{joint.name}: {joint.state.replace('_', ' ')}"
            charts.append(Chart(title, names, known, unit.factor, unit.label, "campaigns", ends, True))
        return figure_of(f"Trend: {self._headline()}", charts)
