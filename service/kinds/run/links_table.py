"""Tables of elastic links for people: which model the readings call for, and what each element explains."""

from __future__ import annotations

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.run.links import LinkCompliance, LinksResult, ModelSelection

_MODEL_NAMES = {
    "joints": "joints",
    "coupled_joints": "coupled joints",
    "diagonal_links": "diagonal links",
    "joints_and_links": "joints and links",
}

_SOURCES = {"given": "given", "cross_validation": "by cross-validation"}


def links_report(links: LinksResult, selection: ModelSelection | None) -> list[RenderableType]:
    """Return what bends beside the joints, in tables and lines."""
    certificate = links.certificate
    of_optimum = "of the optimum" if links.loss == "squared" else "of the optimum a target"
    parts: list[RenderableType] = [_elements_table(links)]
    if links.links:
        parts.append(_links_table(links))
    if selection is not None:
        parts.append(selection_table(selection))
    lines = (
        (
            f"{_MODEL_NAMES[links.model]} ({_SOURCES[links.model_source]}), loss {links.loss} "
            f"({_SOURCES[links.loss_source]}), penalty {links.penalty:.3g} ({_SOURCES[links.penalty_source]})"
        ),
        (f"the readings determine {links.effective_freedom:.1f} of {links.parameters} parameters"),
        f"certified: within {certificate.gap:.1e} sigma {of_optimum}; no negative eigenvalue",
    )
    return parts + [Text(f"  {line}", style="dim") for line in lines]


def links_line(links: LinksResult, selection: ModelSelection | None) -> Text:
    """Return in one line what the elastic links add to the joints."""
    scores = {}
    if selection is not None:
        losses = {**selection.losses, links.model: links.loss}
        scores = {e.model: e.compensation for e in selection.models if e.loss == losses[e.model]}
    if selection is None or not {"joints", links.model} <= set(scores):
        return Text(f"  {_MODEL_NAMES[links.model]}: {_percent(1.0 - links.unexplained)} of the deflection")
    chosen = f"; simplest good model: {_MODEL_NAMES[selection.simplest]}"
    return Text(
        f"  {_MODEL_NAMES[links.model]} with loss {links.loss} explain {_percent(scores[links.model])} of "
        f"postures left out, joints alone {_percent(scores['joints'])}"
        f"{'' if selection.simplest == links.model else chosen}"
    )


def _elements_table(links: LinksResult) -> Table:
    table = Table(title="Share of the measured deflection")
    table.add_column("element")
    table.add_column("overall", justify="right")
    table.add_column("least", justify="right")
    table.add_column("greatest", justify="right")
    for element in links.elements:
        name = element.kind if element.joint is None else element.joint
        shares = (element.share, min(element.by_observation), max(element.by_observation))
        label = f"link behind {name}" if element.kind == "link" else name
        table.add_row(Text(label), *(_percent(share) for share in shares))
    table.add_section()
    table.add_row("unexplained", _percent(links.unexplained), "", "")
    return table


def _links_table(links: LinksResult) -> Table:
    table = Table(
        title=f"Links, {_MODEL_NAMES[links.model]}",
        caption="principal compliances, translation in µm/kN and rotation in µrad/(kN·m); freedom: number "
        "of parameters that the readings determine",
    )
    for heading in ("behind", "translation", "rotation", "freedom"):
        table.add_column(heading, justify="left" if heading == "behind" else "right")
    for link in links.links:
        table.add_row(
            Text(link.joint),
            _principal(link, "translation"),
            _principal(link, "rotation"),
            f"{link.effective_freedom:.1f} of {link.parameters}",
        )
    return table


def _principal(link: LinkCompliance, kind: str) -> str:
    values = link.translation if kind == "translation" else link.rotation
    rounding = 1e-9 * values[0].value
    return ", ".join(f"{1e9 * each.value if each.value > rounding else 0.0:.3g}" for each in values)


def selection_table(selection: ModelSelection) -> Table:
    """Return models and losses beside each other."""
    table = Table(
        title="Compensation of held-out configurations",
        caption="mean over the folds ± standard error; the simplest model within one standard error of the "
        "best is marked, each with its loss of least residual",
    )
    for heading in ("model", "loss", "compensation", "std. error", "penalty", ""):
        table.add_column(heading, justify="left" if heading in {"model", "loss", ""} else "right")
    for scored in selection.models:
        marks = []
        if (scored.model, scored.loss) == (selection.chosen, selection.chosen_loss):
            marks.append("[bold]this run[/]")
        if scored.loss == selection.losses.get(scored.model):
            marks += ["[green]simplest within one standard error[/]"] * (scored.model == selection.simplest)
            marks += ["best"] * (scored.model == selection.best)
        penalty = "—" if scored.penalty is None else f"{scored.penalty:.2g}"
        cells = (_percent(scored.compensation), _percent(scored.standard_error), penalty, ", ".join(marks))
        table.add_row(_MODEL_NAMES[scored.model], scored.loss, *cells)
    return table


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
