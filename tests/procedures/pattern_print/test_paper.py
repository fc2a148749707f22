import pytest

from procedures.outcome import BadParameter
from procedures.pattern_print.sheet import ISO_PAPERS, PAPERS, US_PAPERS, paper_named, papers_of_locale


@pytest.mark.parametrize(
    ("environ", "paper"),
    [
        ({}, "A4"),
        ({"LANG": "C.UTF-8"}, "A4"),
        ({"LANG": "de_DE.UTF-8"}, "A4"),
        ({"LANG": "en_GB"}, "A4"),
        ({"LANG": "en_US.UTF-8"}, "Letter"),
        ({"LANG": "fr_CA.UTF-8"}, "Letter"),
        ({"LANG": "es_MX@euro"}, "Letter"),
        ({"LANG": "fil_PH"}, "Letter"),
        ({"LANG": "us"}, "A4"),  # a language, no territory
        ({"LANG": "en_US.UTF-8", "LC_PAPER": "de_DE.UTF-8"}, "A4"),
        ({"LANG": "en_US.UTF-8", "LC_PAPER": ""}, "Letter"),
        ({"LANG": "de_DE.UTF-8", "LC_PAPER": "de_DE.UTF-8", "LC_ALL": "en_US.UTF-8"}, "Letter"),
    ],
)
def test_the_locales_territory_tells_the_paper(environ: dict[str, str], paper: str) -> None:
    assert papers_of_locale(environ)[0].name == paper


def test_larger_charts_find_larger_paper_in_every_locale() -> None:
    for territory in ("DE", "US"):
        assert set(papers_of_locale({"LANG": f"en_{territory}"})) >= set(ISO_PAPERS)


@pytest.mark.parametrize("papers", [ISO_PAPERS, US_PAPERS])
def test_papers_are_upright_and_listed_from_small_to_large(papers) -> None:  # type: ignore[no-untyped-def]
    assert all(paper.width_mm < paper.height_mm for paper in papers)
    assert list(papers) == sorted(papers, key=lambda paper: paper.width_mm * paper.height_mm)


def test_a_paper_is_found_by_its_name() -> None:
    assert paper_named("LETTER") is PAPERS["letter"]
    with pytest.raises(BadParameter, match=r"the paper must be one of a4, .*tabloid; got 'b5'"):
        paper_named("b5")
