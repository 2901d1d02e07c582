"""Tables of elastic links for people: which model the readings call for, and what each element explains."""

from __future__ import annotations

from jointstiff.schemas.model import LinkCompliance, LinksResult, ModelSelection, ScoredModel
from jointstiff.service.tables.table import Column, Line, Part, Table, number, percent

_MODEL_NAMES = {
    "joints": "joints",
    "coupled_joints": "coupled joints",
    "diagonal_links": "diagonal links",
    "joints_and_links": "joints and links",
}

_SOURCES = {"given": "given", "cross_validation": "by cross-validation"}


def links_report(links: LinksResult, selection: ModelSelection | None) -> list[Part]:
    """Return what bends beside the joints, in tables and lines."""
    certificate = links.certificate
    of_optimum = "of the optimum" if links.loss == "squared" else "of the optimum a target"
    parts: list[Part] = [_elements_table(links)]
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
    return parts + [Line(f"  {line}", "dim") for line in lines]


def links_line(links: LinksResult, selection: ModelSelection | None) -> Line:
    """Return in one line what the elastic links add to the joints."""
    scores = {}
    if selection is not None:
        losses = {**selection.losses, links.model: links.loss}
        scores = {e.model: e.compensation for e in selection.models if e.loss == losses[e.model]}
    if selection is None or not {"joints", links.model} <= set(scores):
        return Line(
            f"  {_MODEL_NAMES[links.model]}: {percent(1.0 - links.unexplained)} of the squared deflection"
        )
    chosen = f"; simplest good model: {_MODEL_NAMES[selection.simplest]}"
    return Line(
        f"  {_MODEL_NAMES[links.model]} with loss {links.loss} explain {percent(scores[links.model])} of "
        f"held-out postures, joints alone {percent(scores['joints'])}"
        f"{'' if selection.simplest == links.model else chosen}"
    )


def _elements_table(links: LinksResult) -> Table:
    elements = links.elements
    names = [
        f"link behind {each.joint}" if each.kind == "link" else each.joint or each.kind for each in elements
    ]
    least: list[float | None] = [min(each.by_observation) for each in elements]
    greatest: list[float | None] = [max(each.by_observation) for each in elements]
    return Table(
        [
            Column("element", [*names, "unexplained"], text=True),
            Column("overall", [*(each.share for each in elements), links.unexplained], percent),
            Column("least", [*least, None], percent),
            Column("greatest", [*greatest, None], percent),
        ],
        title="Share of the squared deflection",
        caption="sum 100 %; what the run explains of the mean deflection is a share of lengths",
    )


def _links_table(links: LinksResult) -> Table:
    return Table(
        [
            Column("behind", [link.joint for link in links.links], text=True),
            Column("translation", [_principal(link, "translation") for link in links.links]),
            Column("rotation", [_principal(link, "rotation") for link in links.links]),
            Column("freedom", [f"{each.effective_freedom:.1f} of {each.parameters}" for each in links.links]),
        ],
        title=f"Links, {_MODEL_NAMES[links.model]}",
        caption="principal compliances, translation in µm/kN and rotation in µrad/(kN·m); freedom: number "
        "of parameters that the readings determine",
    )


def _principal(link: LinkCompliance, kind: str) -> str:
    values = link.translation if kind == "translation" else link.rotation
    rounding = 1e-9 * values[0].value
    return ", ".join(f"{1e9 * each.value if each.value > rounding else 0.0:.3g}" for each in values)


def selection_table(selection: ModelSelection) -> Table:
    """Return models and losses beside each other."""
    models = selection.models
    return Table(
        [
            Column("model", [_MODEL_NAMES[each.model] for each in models], text=True),
            Column("loss", [each.loss for each in models], text=True),
            Column("compensation", [each.compensation for each in models], percent),
            Column("std. error", [each.standard_error for each in models], percent),
            Column("penalty", [each.penalty for each in models], number(".2g")),
            Column("", [_mark(each, selection) for each in models], text=True),
        ],
        title="Compensation of held-out configurations",
        caption="mean over the folds ± standard error; the simplest model within one standard error of the "
        "best is marked, each with its loss of least residual",
    )


def _mark(scored: ScoredModel, selection: ModelSelection) -> str:
    """Return what distinguishes a model with a loss."""
    is_chosen = (scored.model, scored.loss) == (selection.chosen, selection.chosen_loss)
    marks = ["this run"] if is_chosen else []
    if scored.loss == selection.losses.get(scored.model):
        marks += ["simplest within one standard error"] * (scored.model == selection.simplest)
        marks += ["best"] * (scored.model == selection.best)
    return ", ".join(marks)
