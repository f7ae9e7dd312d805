"""Images rendered by Rerun's viewer with a Vulkan driver, for example Mesa's software driver."""

import io
import os
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.recording.transport import snapshot, viewer
from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots
from agrobot_mj.simulation import progress

TABS = ["drive", "control", "tyres", "estimator", "network", "info"]
DRIVERS = [Path(root) / "vulkan" / "icd.d" for root in ("/usr/share", "/etc", "/usr/local/share")]
needs_vulkan = pytest.mark.skipif(
    sys.platform == "linux" and not any(folder.is_dir() and any(folder.iterdir()) for folder in DRIVERS),
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1",
)


def test_frames_of_an_animation_have_the_same_colour_palette():
    frames = [Image.new("RGB", (8, 4), colour) for colour in ["red"] * 30 + ["green"] * 10]
    drawn = frames[0].quantize(palette=snapshot.common_palette(frames)).convert("RGB")
    assert drawn.getpixel((0, 0))[0] > 240


@pytest.mark.parametrize(("t", "end", "first", "last"), [(3, 25.4, 3, 12.9), (60, 25.4, 15.4, 25.3), (60, 2, 0, 1.9)])
def test_animation_shows_motion_up_to_the_end_of_the_run(t, end, first, last):
    times = snapshot.frame_times(t, end)
    assert (times[0], times[-1]) == pytest.approx((first, last))


@pytest.fixture(scope="module", params=[TABS[:2], pytest.param(TABS, marks=pytest.mark.slow)], ids=len)
def tabs(request):
    """Return the tabs to render: two tabs, or all."""
    return request.param


@pytest.fixture(scope="module")
def pictures(eight, tabs, tmp_path_factory):
    """Return images (height, width, 3) of the tabs of a recording at 20 s, by tab."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(snapshot, "TRIES", 10)
        written = snapshots(eight.path, [20.0], tmp_path_factory.mktemp("pictures"), [tab.title() for tab in tabs])
    return {path.stem.partition("_")[0]: np.asarray(Image.open(path).convert("RGB")).astype(int) for path in written}


def near(picture, colour, tolerance=24):
    """Return the fraction of the image with nearly this colour."""
    return (abs(picture - np.array(colour)).max(axis=-1) < tolerance).mean()


@needs_vulkan
def test_recording_tab_is_rendered_completely(pictures, tabs):
    assert list(pictures) == tabs
    for name, picture in pictures.items():
        assert picture.shape == (1080, 1920, 3), name
        assert picture.std() > 10, name


@needs_vulkan
def test_rendered_scene_shows_sky_ground_tractor_and_tracks(pictures):
    scene = pictures["drive"][60:620, 0:1140]
    r, g, b = np.moveaxis(scene, -1, 0)
    assert near(scene, (0xB9, 0xCD, 0xDB)) > 0.05, "sky"
    assert ((g > r) & (g > b + 20)).mean() > 0.2, "ground"
    middle = scene[100:480, 350:800]
    assert (middle.max(axis=-1) < 70).mean() > 0.02, "tyres"
    assert ((middle[..., 2] > middle[..., 0] + 40) & (middle[..., 2] < 190)).mean() > 0.01, "paint"


@needs_vulkan
def test_rendered_curves_have_the_colours_of_their_legends(pictures):
    beside = pictures["drive"][90:, 1160:]
    for colour in ((0x56, 0xB4, 0xE9), (0xE6, 0x9F, 0x00), (0xD5, 0x5E, 0x00)):
        assert near(beside, colour) > 0.0005, colour
    for name in {"control", "tyres", "estimator"} & pictures.keys():
        assert near(pictures[name], (0xE6, 0x9F, 0x00)) > 0.0005, name


@pytest.mark.slow
@needs_vulkan
def test_recording_tab_can_be_selected_and_an_unknown_tab_is_reported(eight, tmp_path):
    (path,) = snapshots(eight.path, [3.5], tmp_path, ["Info"])
    assert path == tmp_path / "info_3.5.png"
    (alone,) = snapshots(eight.path, [3.5], tmp_path, ["tractor"], size=(640, 400))
    view = np.asarray(Image.open(alone).convert("RGB")).astype(int)
    assert alone.name == "tractor_3.5.png"
    assert view.shape[1] > 600
    assert near(view[:20], (0xB9, 0xCD, 0xDB)) > 0.9, "sky up to the edge, no bar"
    with pytest.raises(ScenarioError, match=r"no tab or view Engine \(available: Drive, Control.*, Tractor"):
        snapshots(eight.path, [1.0], tmp_path / "none", ["Engine"])
    assert not (tmp_path / "none").exists()


def test_error_for_a_missing_vulkan_driver_names_the_package(eight, tmp_path, monkeypatch):
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nonexistent")
    with pytest.raises(SnapshotError, match="apt-get install mesa-vulkan-drivers libvulkan1"):
        snapshots(eight.path, [1.0], tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_viewer_that_fails_to_start_causes_no_traceback(eight, tmp_path, monkeypatch):
    monkeypatch.setattr(snapshot, "RERUN", (sys.executable, "-c", "raise SystemExit(1)"))
    with pytest.raises(SnapshotError, match="no images"):
        snapshots(eight.path, [1.0], tmp_path)


def test_slow_viewer_start_is_retried_with_longer_timeouts(eight, tmp_path, monkeypatch):
    """The final error message names the file, the cause and the remedy."""
    patience = []

    def late(process, port, seconds):
        patience.append(seconds)
        raise RuntimeError("the viewer did not start")

    monkeypatch.setattr(snapshot, "RERUN", (sys.executable, "-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(snapshot, "_connect_viewer", late)
    with pytest.raises(SnapshotError) as error:
        snapshots(eight.path, [1.0], tmp_path / "none")
    assert patience == [snapshot.START_S * k for k in range(1, snapshot.TRIES + 1)]
    assert str(error.value).startswith(f"{eight.path}: no images in 3 attempts: the viewer did not start")
    assert "retry on an idle computer" in str(error.value)
    assert not (tmp_path / "none").exists()


def test_images_rendered_before_a_crash_are_kept(eight, tmp_path, monkeypatch, capsys):
    class Client:
        def __init__(self):
            self.breaks = len(clients) == 0
            clients.append(self)

        def set_blueprint(self, layout, scope):
            """Do nothing. The real client of the viewer has this method."""

        def get_state(self):
            line = SimpleNamespace(name="sim_time", end=25_400_000_000)
            return SimpleNamespace(recordings=[SimpleNamespace(timelines=[line])])

    layout = {"root": {"ContainerBlueprint": {"active_tab": ""}}}
    clients, drawn = [], []

    def picture(viewer, t, view, settle_s=0.0):
        if viewer.breaks and drawn:
            raise ConnectionError("gone")
        drawn.append(t)
        shown = np.zeros((1080, 1920, 3), dtype=np.uint8)
        shown[:, 15 * len(drawn) :] = 255
        return Image.fromarray(shown)

    monkeypatch.setattr(snapshot, "RERUN", (sys.executable, "-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(snapshot, "_connect_viewer", lambda process, port, seconds: Client())
    monkeypatch.setattr(snapshot, "_open_recording", lambda viewer, file, readable, patience: layout)
    monkeypatch.setattr(snapshot, "_tabs", lambda file, layout: ("root", {"Drive": "a"}))
    monkeypatch.setattr(snapshot, "_frame", picture)
    assert snapshots(eight.path, [1.0, 2.0], tmp_path) == [tmp_path / "drive_1.png", tmp_path / "drive_2.png"]
    assert (drawn, len(clients)) == ([1.0, 2.0], 2)
    assert capsys.readouterr().err == ""
    assert snapshots(eight.path, [], tmp_path) == [tmp_path / "drive_25.4.png"]
    with pytest.raises(ScenarioError, match=r"--at 500: the recording ends at 25\.4 s"):
        snapshots(eight.path, [1.0, 500.0], tmp_path)
    monkeypatch.setattr(progress, "BETWEEN_LINES_S", 0.0)
    (animation,) = snapshots(eight.path, [3.0], tmp_path, ["drive"], "gif", quiet=False)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 100
    assert lines[39].startswith(f"{eight.path.name}: 100 pictures: 40 done")
    with Image.open(animation) as moving:
        assert (moving.format, moving.n_frames, moving.size) == ("GIF", 100, (960, 540))
        assert moving.info["duration"] * moving.n_frames == 10_000


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads Linux's table of sockets")
def test_browser_viewer_is_served_on_loopback_only(eight):
    environment = {**os.environ, "PYTHONPATH": str(Path(viewer.__file__).parents[3]), "BROWSER": "true"}
    command = [sys.executable, "-m", "agrobot_mj", "view", "--web", str(eight.path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as process:
        try:
            url = process.stdout.readline().split()[0]
            page = fetched(url.partition("?")[0])
            assert b"<html" in page.lower()
            ports = {int(part) for part in (url.split(":")[2].split("?")[0], url.split("%3A")[-1].split("%2F")[0])}
            lines = [line for table in ("tcp", "tcp6") for line in listening(table) if port_of(line) in ports]
            bound = {line.split()[1].split(":")[0] for line in lines}
            assert bound == {"0100007F"}
        finally:
            process.send_signal(signal.SIGTERM)
    for _ in range(3000):
        left = [line for table in ("tcp", "tcp6") for line in listening(table) if port_of(line) in ports]
        if not left:
            break
        time.sleep(0.1)
    assert not left


def port_of(line):
    return int(line.split()[1].split(":")[1], 16)


def fetched(url):
    for _ in range(300):
        try:
            return io.BytesIO(urllib.request.urlopen(url, timeout=5).read()).getvalue()
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"nothing at {url}")


def listening(table):
    """Return the rows of listening sockets in a socket table of Linux."""
    lines = Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    return [line for line in lines if line.split()[3] == "0A"]
