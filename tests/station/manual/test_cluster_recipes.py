"""The recipes for SLURM and Kubernetes in the manual, as far as they show without a cluster."""

import ast
import re
import shlex
from importlib import resources

import pytest

PAGE = resources.files("station.manual").joinpath("how-to/batch.md").read_text(encoding="utf-8")


def recipe(language, word):
    """The block of the page in this language that contains a word."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (block,) = (one for one in blocks if word in one)
    return block


def test_the_python_recipes_are_python():
    for word in ("SLURMCluster", "KubeCluster"):
        ast.parse(recipe("python", word))


@pytest.mark.slow  # it starts a scheduler
@pytest.mark.filterwarnings("ignore")
def test_the_slurm_job_starts_single_threaded_workers_in_the_station_s_environment(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    monkeypatch.chdir(tmp_path)
    code = ast.parse(recipe("python", "SLURMCluster"))
    # all up to the scaling, which needs SLURM
    end = next(i for i, one in enumerate(code.body) if "scale" in ast.unparse(one))
    made = {}
    exec(compile(ast.Module(code.body[:end], []), "recipe", "exec"), made)
    try:
        script = made["cluster"].job_script()
    finally:
        made["cluster"].close()
    assert "#SBATCH --cpus-per-task=8" in script
    (worker,) = (line for line in script.splitlines() if "dask_worker" in line)
    words = shlex.split(worker)
    assert words[0] == "/opt/station/bin/python"
    assert words[words.index("--nworkers") + 1] == "8"
    assert words[words.index("--nthreads") + 1] == "1"
    assert words[3].startswith(("tls://", "tcp://"))


def test_the_kubernetes_recipe_mounts_the_folders_of_the_photographs_in_every_worker():
    yaml = pytest.importorskip("yaml")
    spec = yaml.safe_load(recipe("yaml", "DaskCluster"))
    assert (spec["apiVersion"], spec["kind"]) == ("kubernetes.dask.org/v1", "DaskCluster")
    (worker,) = spec["spec"]["worker"]["spec"]["containers"]
    (scheduler,) = spec["spec"]["scheduler"]["spec"]["containers"]
    assert worker["args"][:2] == ["dask", "worker"] or worker["args"][0] == "dask-worker"
    assert worker["args"][worker["args"].index("--nthreads") + 1] == "1"
    assert worker["image"] == scheduler["image"]  # one version of the station and of Dask
    mounts = {one["name"]: one["mountPath"] for one in worker["volumeMounts"]}
    volumes = {one["name"] for one in spec["spec"]["worker"]["spec"]["volumes"]}
    assert set(mounts) == volumes
    assert mounts["shoot"] == "/shoot"
    assert {one["name"] for one in scheduler["ports"]} == {"tcp-comm", "http-dashboard"}


@pytest.mark.filterwarnings("ignore")
def test_the_operator_s_package_knows_what_the_kubernetes_recipe_calls():
    operator = pytest.importorskip("dask_kubernetes.operator", reason="dask-kubernetes is not installed")
    calls = [one for one in ast.walk(ast.parse(recipe("python", "KubeCluster"))) if isinstance(one, ast.Call)]
    (made,) = (one for one in calls if ast.unparse(one.func).endswith("KubeCluster"))
    known = operator.KubeCluster.__init__.__code__.co_varnames
    assert {one.arg for one in made.keywords} <= set(known)
