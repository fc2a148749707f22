"""Generation of a command from the settings of a procedure: arguments, options, help, results, exit code."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.terms import (
    certificate_options,
    details_of,
    jobs_option,
    overlay_option,
    specification_option,
    terms_of,
    terms_options,
)
from station.cli.result_log import finish, log_result
from station.cli.terminal.command import (
    PATH,
    FiniteNumber,
    StationCommand,
    force_option,
    json_option,
    options,
    strict_option,
)
from station.cli.terminal.progress import progress
from station.common.errors import FAILED_ITEMS, log, log_json_option
from station.common.models import ModelField, TableSource, fields_of, read_model
from station.procedure.base import Inputs, Procedure, to_record
from station.procedure.schema import procedure_named, procedure_names

if TYPE_CHECKING:
    from station.results.measurement import Measurement
    from station.results.plane_result import PlaneResult

ARGUMENTS: dict[Inputs, tuple[str, int]] = {
    Inputs.PHOTOGRAPH: ("IMAGE", 1),
    Inputs.PAIR: ("A B", 2),
    Inputs.PHOTOGRAPHS: ("PHOTO...", -1),
    Inputs.FOLDER: ("FOLDER", 1),
    Inputs.SCENE: ("IMAGES...", -1),
    Inputs.SERIES: ("FOLDER", 1),
    Inputs.SEVERAL: ("PHOTO...", -1),
    Inputs.RESULTS: ("FIRST SECOND...", -1),
}


def __getattr__(name: str) -> click.Command:
    if name.startswith("_") or name not in procedure_names():
        raise AttributeError(name)
    return command_for(procedure_named(name))


@cache
def command_for(procedure: Procedure[Any]) -> click.Command:
    """The command of a procedure."""
    metavar, count = ARGUMENTS[procedure.inputs]
    settings = fields_of(procedure.Settings)

    def measure(photographs: Any, **given: Any) -> None:
        typed = {setting.name: given.pop(setting.name) for setting in settings}
        chosen = {name: value for name, value in typed.items() if value is not None and value != ()}
        chosen |= {one.name: one.kind(chosen[one.name]) for one in settings if one.choices and one.name in chosen}
        paths = [photographs] if count == 1 else list(photographs)
        run = _run_batch if procedure.inputs is Inputs.SERIES else _measure
        run(procedure, paths, chosen, given)

    command: Any = click.pass_context(lambda context, **given: measure(**given))
    of_result = [
        click.option("--out", type=PATH, required=True, help="Folder for the results."),
        *([click.option("--report/--no-report", default=procedure.usual_page, show_default=True,
                        help=f"Write {procedure.page_name} too, for people.")] if procedure.has_page else []),
        *([jobs_option] if procedure.inputs is Inputs.SERIES else [certificate_options]),
        *([overlay_option] if procedure.has_mtf and procedure.inputs is not Inputs.SERIES else []),
        strict_option,
        json_option,
        log_json_option,
    ]  # fmt: skip
    of_terms = [terms_options] if procedure.has_mtf else [specification_option, force_option]
    command = options(*map(_option, settings), *of_terms, *of_result)(command)
    argument = click.argument(
        "photographs", type=PATH, nargs=count, required=True, metavar=procedure.argument or metavar
    )
    return click.command(procedure.name, cls=ListCommand, help=procedure.help)(argument(command))


class ListCommand(StationCommand):
    """A command whose options of several texts also accept them as `--shape FILE1 FILE2` before the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each further value, at most one for each photograph."""
        lists = {
            name
            for param in self.params
            if isinstance(param, click.Option) and param.multiple and param.type is click.STRING
            for name in param.opts
        }
        most = max(2, next((n for n, arg in enumerate(args) if arg.startswith("-")), len(args)))
        spelled: list[str] = []
        count, option = 0, ""
        for arg in args:
            if arg.startswith("-"):
                count, option = 0, arg if arg in lists else ""
            elif option and count < most:
                spelled += [option] if count else []
                count += 1
            spelled.append(arg)
        return super().parse_args(ctx, spelled)


def _option(one: ModelField) -> Any:
    """A setting as an option; if it is not given, the default of the model applies."""
    flags = [one.option, one.name]
    shown = f"{one.description}  [default: {one.default}]" if one.default not in (None, False, ()) else one.description
    if one.kind is bool and one.default is None:
        return click.option(f"{one.option}/--no-{one.option.removeprefix('--')}", one.name, default=None, help=shown)
    if one.kind is bool:
        return click.option(*flags, is_flag=True, default=None, help=one.description)
    return click.option(
        *flags, type=_type(one), multiple=one.several, required=one.required, help=shown,
        metavar=one.extra("metavar") or None,
    )  # fmt: skip


class NumberOr(click.ParamType):  # type: ignore[type-arg]  # generic in some releases only
    """An integer or a keyword."""

    def __init__(self, word: str) -> None:
        self.word, self.name = word, f"{word}|N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        try:
            return self.word if value == self.word else int(str(value))
        except ValueError:
            self.fail(f"give a whole number, or {self.word}; got {value!r}", param, ctx)


def _type(field: ModelField) -> click.ParamType[Any]:
    if field.word:
        return NumberOr(field.word)
    if field.choices:
        return click.Choice(field.choices, case_sensitive=False)
    if field.kind is int:
        least, most = (None if bound is None else int(bound) for bound in (field.least, field.most))
        return click.IntRange(least, most)
    if field.kind is float:
        return FiniteNumber(min=field.least, max=field.most)
    return click.Path(path_type=Path) if field.kind is Path else click.STRING


def _measure(procedure: Procedure[Any], paths: Sequence[Path], chosen: dict[str, Any], given: dict[str, Any]) -> None:
    """Measure, write, report, and exit with the code of the verdict."""
    done = list(_results(procedure, paths, chosen, given))
    finish([plane for planes, _, _ in done for plane in planes], "".join(text for _, text, _ in done),
           as_json=given["as_json"], strict=given["strict"])  # fmt: skip
    if any(missed for _, _, missed in done):
        raise click.exceptions.Exit(FAILED_ITEMS)


def _run_batch(procedure: Procedure[Any], paths: Sequence[Path], chosen: dict[str, Any], given: dict[str, Any]) -> None:
    from station.batch.procedure_file import BatchProcedure
    from station.cli.batch import carry_out

    terms, settings = terms_of(given), read_model(procedure.Settings, chosen, TableSource())
    settings.check()
    batch = BatchProcedure(procedure, settings, terms)
    carry_out(
        batch, (*paths,), given["out"], jobs=given["jobs"], reports=given["report"], strict=given["strict"],
        as_json=given["as_json"],
    )  # fmt: skip


def _results(
    procedure: Procedure[Any], paths: Sequence[Path], chosen: dict[str, Any], given: dict[str, Any]
) -> Iterator[tuple[Sequence[PlaneResult], str, bool]]:
    """Planes and record of every result without large arrays, and whether an input was unusable."""
    from station.calibration.field_photographs import photographs
    from station.results.measurement import write_measurement
    from station.results.result_files import ResultFolder

    out, terms, overlays = given["out"], terms_of(given), given.get("overlays", ())
    settings = read_model(procedure.Settings, chosen, TableSource())
    settings.check()
    overlays, details = procedure.read_overlays(overlays, terms), details_of(given)
    if procedure.inputs is Inputs.PHOTOGRAPHS:
        paths = [path for one in paths for path in ([one] if one.is_file() else photographs(one))]
    inputs = [*paths, *procedure.files(paths, settings)]
    with progress(procedure.steps(paths)) as shown:
        results = procedure.measurements(paths, settings, terms, shown)
        for place in procedure.places(paths):
            start = time.perf_counter()
            with ResultFolder(out / place, force=force_option.given(), inputs=inputs) as folder:
                measurement = next(results)
                taken = round(time.perf_counter() - start, 3)
                given_settings = measurement.head.settings or to_record(settings)
                head = replace(
                    measurement.head, arguments=[str(one) for one in paths], settings=given_settings, duration_s=taken
                )
                measurement = replace(measurement, head=head, overlays=overlays)
                if (given.get("report") or overlays) and procedure.draws(measurement):
                    folder.write(procedure.page_name, procedure.page(measurement))
                if details is not None:
                    from station.reports.certificate_print import write_certificate

                    write_certificate(folder, procedure.report(measurement), measurement.record(), details)
                text = write_measurement(folder, measurement)
            report(procedure, measurement, out / place / "result.json")
            yield measurement.planes, text, bool(procedure.missed(measurement))


def report(procedure: Procedure[Any], measurement: Measurement, written: Path) -> None:
    """Log unusable photographs, every plane with its numbers, and the files written."""
    for miss in procedure.missed(measurement):
        log("missed", str(miss), level="warning", remedy=miss.remedy)
    for plane in measurement.planes:
        log_result(plane)
    for line in procedure.lines(measurement):
        log(procedure.name, line)
    log("written", f"wrote {written}", path=str(written))
