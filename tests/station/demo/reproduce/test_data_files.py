import hashlib

import pytest

from procedures import BadInput, read_film
from station.demo.reproduce import catalogue
from station.demo.reproduce.catalogue import PUBLISHED_FILES, ROWS
from station.demo.reproduce.rays_rows import film_and_reference
from station.demo.reproduce.row import Setting


@pytest.fixture
def published(tmp_path):
    source = tmp_path / "photograph.pgm"
    source.write_bytes(b"a photograph")
    digest = hashlib.sha256(b"a photograph").hexdigest()
    return catalogue.PublishedFile("photographs/one.pgm", source.as_uri(), digest, "CC-BY")


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(catalogue, "FILM_SIDE", 16)
    monkeypatch.setattr(catalogue, "REFERENCE_SAMPLES", 8)


def test_a_folder_is_completed_by_photographs_and_rendered_films(published, tmp_path, small):
    folder, sentences = tmp_path / "data", []
    catalogue.fetch(folder, [published], progress=lambda done, steps=1: sentences.append(done))
    assert (folder / "photographs/one.pgm").read_bytes() == b"a photograph"
    assert read_film(folder / "rays/room_00064.npz").count.tolist() == [[64] * 16] * 16
    film, reference = film_and_reference(Setting(folder), 256)
    assert film.mean.shape == reference.mean.shape == (16, 16, 3)
    assert len(sentences) == 4
    catalogue.fetch(folder, [published], progress=lambda done, steps=1: sentences.append(done))
    assert len(sentences) == 4


def test_other_contents_are_refused_and_not_kept(published, tmp_path):
    (tmp_path / "photograph.pgm").write_bytes(b"another photograph")
    with pytest.raises(BadInput, match=f"must have the SHA-256 {published.sha256}; got"):
        catalogue.fetch(tmp_path / "data", [published])
    assert not (tmp_path / "data/photographs/one.pgm").exists()


def test_an_unreachable_photograph_names_the_place_to_put_it(published, tmp_path):
    (tmp_path / "photograph.pgm").unlink()
    with pytest.raises(BadInput, match="must be reachable") as error:
        catalogue.fetch(tmp_path / "data", [published])
    assert str(tmp_path / "data/photographs/one.pgm") in error.value.remedy


def test_the_published_photographs_are_those_of_the_shared_data(shared_data):
    assert all(one.is_in(shared_data) for one in PUBLISHED_FILES)


def test_what_rows_need_is_fetched_or_made_by_other_programs():
    fetched = {one.path for one in PUBLISHED_FILES} | set(catalogue.FILMS) | {catalogue.REFERENCE}
    elsewhere = [row.name for row in ROWS if any(not set(names.split("|")) & fetched for names in row.needs)]
    assert elsewhere == ["published-photograph", "published-pair", "rays-cornell"]
