"""Image, workflows, conda recipe, citation, paper and sizes agree with the project and name existing files."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from removed import REMOVED_PAGES

from agrobot_mj import __version__

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
WORKFLOWS = {path.stem: yaml.safe_load(path.read_text("utf-8")) for path in (ROOT / ".github/workflows").glob("*.yml")}
RECIPE = yaml.safe_load((ROOT / "recipe/recipe.yaml").read_text("utf-8"))
INSTRUCTIONS = re.findall(r"^([A-Z]+) (.*)$", (ROOT / "Dockerfile").read_text("utf-8").replace("\\\n", ""), re.M)
IN_IMAGE = re.findall(r"^!(\S+)$", (ROOT / ".dockerignore").read_text("utf-8"), re.M)
CONDA = {"mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}
"""Names of packages on conda-forge that differ from the names on PyPI."""


def verbs():
    return set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text("utf-8"), re.M))


def test_citation_recipe_and_changelog_have_the_current_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == RECIPE["context"]["version"] == __version__
    assert re.search(rf"^## {re.escape(__version__)} - ", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert citation["license"] == RECIPE["about"]["license"] == PROJECT["license"]


def test_conda_recipe_has_the_dependencies_of_the_package():
    def specifiers(text):
        return SpecifierSet(f"=={text}" if text[0].isdigit() else text)

    found = dict(line.split(" ", 1) for line in RECIPE["requirements"]["run"])
    assert found.pop("python") == ">=${{ python_min }}"
    assert f">={RECIPE['context']['python_min']}" == PROJECT["requires-python"]
    wanted = {each.name: each.specifier for each in map(Requirement, PROJECT["dependencies"])}
    assert {name: specifiers(text) for name, text in found.items()} == {CONDA.get(n, n): s for n, s in wanted.items()}
    assert RECIPE["build"]["python"]["entry_points"] == [f"{k} = {v}" for k, v in PROJECT["scripts"].items()]
    assert (ROOT / "recipe" / RECIPE["source"]["path"] / RECIPE["about"]["license_file"]).is_file()


@pytest.mark.parametrize("name", sorted(WORKFLOWS))
def test_workflows_name_existing_files(name):
    jobs = WORKFLOWS[name]["jobs"]
    for job in jobs.values():
        assert {job.get("needs")} if isinstance(job.get("needs"), str) else set(job.get("needs", ())) <= set(jobs)
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step), step
            assert re.fullmatch(r"[\w-]+/[\w-]+@[\w./]+", step.get("uses", "a/b@c"))
            lock = step.get("with", {}).get("cache-dependency-path", "Makefile")
            assert (ROOT / lock).is_file()
            words = shlex.split(step.get("run", ""))
            if words[:1] == ["make"]:
                assert set(words[1:]) <= verbs()
            elif words and "/" in words[0]:
                assert (ROOT / words[0]).is_file()


NODE_24 = {
    **{"actions/checkout": 5, "actions/setup-python": 6, "actions/upload-artifact": 6, "actions/download-artifact": 7},
    **{"actions/upload-pages-artifact": 5, "actions/deploy-pages": 5, "astral-sh/setup-uv": 7},
}
"""First major version of each action on Node 24. Runners have no Node 20 since September 2026."""


@pytest.mark.parametrize("name", sorted(WORKFLOWS))
def test_workflows_have_minimum_permissions_and_supported_actions(name):
    assert WORKFLOWS[name]["permissions"] == {"contents": "read"}
    used = [s["uses"].split("@") for job in WORKFLOWS[name]["jobs"].values() for s in job["steps"] if "uses" in s]
    versions = {action: int(tag.removeprefix("v")) for action, tag in used if tag.startswith("v")}
    assert versions
    assert {action for action, major in versions.items() if major < NODE_24[action]} == set()


def test_readme_links_in_a_release_point_to_its_repository(tmp_path):
    (command,) = (s["run"] for s in WORKFLOWS["release"]["jobs"]["dist"]["steps"] if "README.md" in s.get("run", ""))
    copy = Path(shutil.copy(ROOT / "README.md", tmp_path))
    where = {"GITHUB_SERVER_URL": "https://example.org", "GITHUB_REPOSITORY": "a/b", "GITHUB_REF_NAME": "v9.9.9"}
    subprocess.run(["sh", "-c", command], cwd=tmp_path, env={**os.environ, **where}, check=True)
    targets = re.findall(r"\]\(([^)#\s]+)", copy.read_text("utf-8"))
    assert [target for target in targets if target.startswith("docs/")] == []
    bases = [f"https://example.org/a/b/{kind}/v9.9.9/" for kind in ("raw", "blob")]
    ours = [target.removeprefix(base) for base in bases for target in targets if target.startswith(base)]
    assert len(ours) > 5
    assert [name for name in ours if not ((ROOT / name).exists() or name.startswith(REMOVED_PAGES))] == []
    assert all(target.startswith(bases[0]) for target in targets if target.endswith((".jpg", ".gif", ".png")))


def test_release_workflow_uploads_the_output_folders_of_make():
    jobs = WORKFLOWS["release"]["jobs"]
    for job, verb, place in (("dist", "dist-check", "dist"), ("site", "docs", "site")):
        steps = jobs[job]["steps"]
        made = [k for k, step in enumerate(steps) if step.get("run") == f"make {verb}"]
        taken = [k for k, step in enumerate(steps) if step.get("with", {}).get("path") == place]
        assert made < taken
        assert f"{place}/" in (ROOT / ".gitignore").read_text("utf-8").replace("/site", "site").split()


def test_release_workflow_sets_the_url_of_its_repository(tmp_path):
    (command,) = (s["run"] for s in WORKFLOWS["release"]["jobs"]["dist"]["steps"] if "pyproject" in s.get("run", ""))
    copy = shutil.copy(ROOT / "pyproject.toml", tmp_path)
    where = {"GITHUB_SERVER_URL": "https://example.org", "GITHUB_REPOSITORY": "a/b"}
    subprocess.run(["sh", "-c", command], cwd=tmp_path, env={**os.environ, **where}, check=True)
    urls = tomllib.loads(Path(copy).read_text("utf-8"))["project"]["urls"]
    assert urls == {"Source": "https://example.org/a/b"}


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """Return the files of the checkout that are in the image, with bytecode to avoid compilation."""
    folder = tmp_path_factory.mktemp("image")
    for name in IN_IMAGE:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("*.nb?"))
        else:
            shutil.copy(source, target)
    return folder


@pytest.fixture(scope="module")
def demo(image):
    """Return the commands of the `make` target with which the image is built."""
    (verb,) = (verb for name, text in INSTRUCTIONS if name == "RUN" for verb in re.findall(r"^make (\w+)", text))
    dry = subprocess.run(["make", "-n", verb], cwd=image, capture_output=True, text=True, check=False)
    assert dry.returncode == 0, dry.stderr
    return dry.stdout


def test_docker_image_commands_install_the_package_and_run_its_demo(image, demo):
    """The virtual environment uses the installed packages, so that nothing is downloaded. The run is short."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"PIP_NO_INDEX": "1"}
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", ".venv"], cwd=image, check=True)
    (packages,) = (image / ".venv").glob("lib/python*/site-packages")
    (packages / "host.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    install = ["make", "install", f"PYTHON={sys.executable}"]
    done = subprocess.run(install, cwd=image, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (drive,) = (line for line in demo.splitlines() if " -m agrobot_mj " in line)
    short = f"{drive.partition(';')[0]} --set duration_s=0.2 --set physics=fast --no-rrd --jobs 1 --quiet"
    plain = environment | {"NUMBA_DISABLE_JIT": "1"}  # else the kernels are compiled for this folder
    subprocess.run(short, shell=True, cwd=image, env=plain, capture_output=True, check=True)
    (folder,) = re.findall(r"--out ([^\s;]+)", drive)
    assert (image / folder / "comparison.json").is_file()


def test_docker_image_contains_all_files_of_the_demo(image, demo):
    assert "--require-hashes" in demo
    named = set(re.findall(r"(?<![\w./-])(?:\w[\w-]*/)*[\w-]+\.(?:py|lock|toml|txt)\b", demo))
    assert "requirements.lock" in named
    assert [name for name in sorted(named) if not (image / name).is_file()] == []
    build = [sys.executable, "-c", "import hatchling.build as b; print(b.build_editable('.'))"]
    assert subprocess.run(build, cwd=image, capture_output=True, text=True, check=True).stdout.endswith(".whl\n")


def test_docker_image_serves_the_recording_of_the_demo():
    (command,) = (text for name, text in INSTRUCTIONS if name == "CMD")
    words = shlex.split(yaml.safe_load(command)[2])
    words = words[words.index("exec") + 1 :]
    program = Path(sys.executable).with_name(words[0])
    said = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    assert [word for word in words if word.startswith("--") and word not in said.split()] == []
    makefile = (ROOT / "Makefile").read_text("utf-8")
    demo, recording = (re.search(rf"^{name} := (.*)$", makefile, re.M)[1] for name in ("DEMO", "RECORDING"))
    assert words[-1] == recording.replace("$(DEMO)", demo)
    ports = {words[words.index(option) + 1] for option in ("--port", "--web-viewer-port")}
    assert ports == set(dict(INSTRUCTIONS)["EXPOSE"].split())
    assert all(f"--publish 127.0.0.1:{port}:{port}" in (ROOT / "Dockerfile").read_text("utf-8") for port in ports)


@pytest.mark.slow
def test_docker_image_builds():
    if not shutil.which("docker") or subprocess.run(["docker", "info"], capture_output=True, check=False).returncode:
        pytest.skip("needs docker and its daemon")
    subprocess.run(["docker", "build", "--tag", "agrobot-mj-test", "."], cwd=ROOT, check=True)


@pytest.mark.slow  # what the command installs runs by default in test_wheel.py
def test_scenario_runs_with_uvx(tmp_path):
    uv = os.environ.get("UV") or shutil.which("uv")
    if not uv:
        pytest.skip("needs uv: pip install uv, or UV=/its/path")
    short = ["--set", "duration_s=2", "--out", "circle"]
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [uv, "tool", "run", "--from", f"{ROOT}[recording]", "agrobot-mj", "run", "circle", *short]
    subprocess.run(command, cwd=tmp_path, env=kept, check=True)
    assert (tmp_path / "circle" / "run.rrd").is_file()


def test_install_page_lists_every_dependency_and_extra():
    page = (ROOT / "docs/install.md").read_text("utf-8")
    listed = set(re.findall(r"^\| `?([\w-]+)`? \| +[\d.]+ \|", page, re.M))
    needed = {Requirement(line).name for line in PROJECT["dependencies"]}
    assert listed == needed | set(PROJECT["optional-dependencies"])


def test_paper_is_below_its_word_limit_and_has_the_required_sections():
    head, text = (ROOT / "paper.md").read_text("utf-8").removeprefix("---\n").split("\n---\n", 1)
    about = yaml.safe_load(head)
    assert [author["name"] for author in about["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert {author["affiliation"] for author in about["authors"]} == {place["index"] for place in about["affiliations"]}
    assert (ROOT / about["bibliography"]).is_file()  # its keys: tests/docs/test_references.py
    assert len(text.split()) <= 1000
    headings = set(re.findall(r"^# (.*)$", text, re.M))
    assert {"Summary", "Statement of need", "State of the field", "Validation", "Limits", "References"} <= headings
