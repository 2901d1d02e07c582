"""Commands that identify campaigns, without a server: `identify`, `compare`, `pair`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Final, TypeVar

import typer

from jointstiff.service.cli.answers import refused
from jointstiff.service.cli.options import (
    AsJson,
    CampaignFile,
    Details,
    ElasticityChoice,
    FirstFile,
    Links,
    LossChoice,
    MethodChoice,
    Priors,
    Repetitions,
    Resample,
    SecondFile,
    Seed,
    Stiffer,
    Unit,
    UnitChoice,
    WeightingChoice,
    chains,
    link_names,
    priors,
)

if TYPE_CHECKING:
    from jointstiff.schemas.comparison import ComparisonOptions
    from jointstiff.schemas.run.options import RunOptions

Options = TypeVar("Options", "RunOptions", "ComparisonOptions")

_INCLUDED: Final = {True: "included", False: "neglected", None: None}


def identify(
    file: CampaignFile,
    *,
    method: Annotated[MethodChoice | None, typer.Option(help="Instead of the file's.")] = None,
    weighting: Annotated[WeightingChoice | None, typer.Option(help="Instead of the file's.")] = None,
    characteristic_length: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Length in m for weighting characteristic_length; default: least condition number.",
        ),
    ] = None,
    positive: Annotated[
        bool | None,
        typer.Option("--positive/--unconstrained", help="Constrain compliances to be zero or positive."),
    ] = None,
    loss: Annotated[
        LossChoice | None,
        typer.Option(
            help="Loss function; huber limits the effect of a bumped target. Default automatic: squared for "
            "joints; with elastic links chosen by cross-validation."
        ),
    ] = None,
    huber_threshold: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=100.0,
            metavar="SIGMAS",
            help="Threshold of loss huber, in units of sigma; default 2.8.",
        ),
    ] = None,
    complementary_stiffness: Annotated[
        bool | None,
        typer.Option(
            "--complementary-stiffness/--neglect-complementary-stiffness",
            help="Include the complementary stiffness K_c, or neglect it.",
        ),
    ] = None,
    prior: Priors = None,
    stiffer: Stiffer = None,
    elasticity: Annotated[
        ElasticityChoice | None,
        typer.Option(
            help="Elements that deflect; automatic: joints, and what a test shows beside them. Loss and "
            "penalty are chosen by cross-validation."
        ),
    ] = None,
    links: Links = None,
    link_penalty: Annotated[
        float | None,
        typer.Option(min=1e-9, max=1e3, help="Weight of the penalty on links; default: cross-validation."),
    ] = None,
    confidence: Annotated[
        float | None, typer.Option(min=0.5, max=0.9999, help="Confidence level of the intervals.")
    ] = None,
    resample: Resample = None,
    repetitions: Repetitions = None,
    seed: Seed = None,
    unit: Unit = UnitChoice.MEGA,
    details: Details = False,
    as_json: AsJson = False,
) -> None:
    """Identify the joint stiffnesses of a campaign, without a server.

    Prints the verdict, the joints and what to do next. docs/glossary.md explains the words.
    """
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.kinds.run import RUN
    from jointstiff.service.library import campaigns
    from jointstiff.service.library.campaigns import read_campaign
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.terminal import console, progress_bar

    chosen = {
        "method": method,
        "weighting": weighting,
        "characteristic_length": characteristic_length,
        "positive": positive,
        "loss": loss,
        "huber_threshold": huber_threshold,
        "complementary_stiffness": _INCLUDED[complementary_stiffness],
        "priors": priors(prior),
        "stiffness_order": chains(stiffer),
        "elasticity": elasticity,
        "links": link_names(links),
        "link_penalty": link_penalty,
        "confidence": confidence,
        "resampling": _resampling(resample, repetitions, seed),
    }
    changes = {name: value for name, value in chosen.items() if value is not None}
    try:
        campaign = read_campaign(file)
        options = _changed(campaign.run, changes)
        with progress_bar(shown=_takes_long(options)) as tell:
            run = campaigns.identify(campaign, options, tell)
    except CampaignError as error:
        raise refused(error.problem) from error
    if as_json:
        typer.echo(run.model_dump_json(indent=2))
    else:
        console().print(job_report(RUN, run, details=details, unit=unit))
    if run.state != "succeeded":
        raise typer.Exit(1)


def compare(
    file: CampaignFile,
    *,
    resample: Resample = None,
    repetitions: Repetitions = None,
    seed: Seed = None,
    positive: Annotated[
        bool | None,
        typer.Option(
            "--positive/--unconstrained",
            help="Fit only constrained, or only unconstrained compliances; default: both.",
        ),
    ] = None,
    unit: Unit = UnitChoice.MEGA,
    details: Details = False,
    as_json: AsJson = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print CSV for spreadsheets.")] = False,
) -> None:
    """Compare the methods on a campaign, unconstrained and constrained, as the paper's Table II does."""
    from jointstiff.schemas.comparison import ComparisonOptions
    from jointstiff.service.kinds.comparison import COMPARISON
    from jointstiff.service.kinds.comparison.tables import entries_sheet
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import campaigns
    from jointstiff.service.library.campaigns import read_campaign
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.files import csv_text
    from jointstiff.service.tables.terminal import console, progress_bar

    constraint = None if positive is None else ["positive" if positive else "unconstrained"]
    chosen = {"constraints": constraint, "resampling": _resampling(resample, repetitions, seed)}
    try:
        campaign = read_campaign(file)
        given = {name: value for name, value in chosen.items() if value is not None}
        options = _changed(ComparisonOptions(confidence=campaign.run.confidence), given)
        with progress_bar(shown=resample is not None) as tell:
            comparison = campaigns.compare(campaign, options, tell)
    except CampaignError as error:
        raise refused(error.problem) from error
    if as_json:
        typer.echo(comparison.model_dump_json(indent=2))
    elif as_csv and comparison.result is not None:
        typer.echo(csv_text(entries_sheet(comparison)), nl=False)
    else:
        console().print(job_report(COMPARISON, comparison, details=details, unit=unit))
    if comparison.state != "succeeded":
        raise typer.Exit(1)


def pair(
    first: FirstFile,
    second: SecondFile,
    *,
    method: Annotated[
        MethodChoice | None, typer.Option(help="Method of identification; overrides the first file.")
    ] = None,
    ordered: Annotated[
        bool,
        typer.Option(
            "--ordered", help="Also fit both in one problem in which no joint is softer in the second."
        ),
    ] = False,
    confidence: Annotated[
        float | None, typer.Option(min=0.5, max=0.9999, help="Confidence level of the intervals.")
    ] = None,
    unit: Unit = UnitChoice.MEGA,
    details: Details = False,
    as_json: AsJson = False,
) -> None:
    """Compare two campaigns: encoders of motors and secondary ones, before and after, unit A and B.

    Both are identified as the run in the first file says.
    """
    from pydantic import ValidationError

    from jointstiff.schemas.pair import PairOptions
    from jointstiff.service.kinds.pair import PAIR
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import campaigns
    from jointstiff.service.library.campaigns import read_campaign
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import invalid_request
    from jointstiff.service.tables.terminal import console

    try:
        campaign, other = read_campaign(first), read_campaign(second)
        options = _changed(campaign.run, {"method": method} if method is not None else {})
        chosen = PairOptions.model_validate(
            {"options": options.model_dump(), "ordered": ordered, "confidence": confidence}
        )
        found = campaigns.pair(campaign, other, chosen)
    except ValidationError as error:
        raise refused(invalid_request(error.errors())) from error
    except CampaignError as error:
        raise refused(error.problem) from error
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    else:
        console().print(job_report(PAIR, found, details=details, unit=unit))
    if found.state != "succeeded":
        raise typer.Exit(1)


def _takes_long(options: "RunOptions") -> bool:
    return options.resampling is not None or (options.elasticity != "joints" and options.link_penalty is None)


def _changed(options: Options, changes: Mapping[str, object]) -> Options:
    from pydantic import ValidationError

    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import invalid_request

    try:
        return type(options).model_validate({**options.model_dump(), **changes})
    except ValidationError as error:
        raise CampaignError(invalid_request(error.errors())) from None


def _resampling(size: int | None, repetitions: int | None, seed: int | None) -> dict[str, int] | None:
    """Return what `--resample` and its companions ask for; None without it.

    Raises:
        typer.BadParameter: a companion without it.
    """
    chosen = {"size": size, "repetitions": repetitions, "seed": seed}
    given = {name: value for name, value in chosen.items() if value is not None}
    if size is None and given:
        raise typer.BadParameter("needs --resample", param_hint=[f"--{name}" for name in given])
    return given or None
