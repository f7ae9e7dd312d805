"""Shared recordings: one page with its viewer, and videos."""

import base64
import gzip
import io
import re
import shutil
import subprocess
import sys

import pytest
from PIL import Image

from agrobot_mj.cli import sharing
from agrobot_mj.recording.transport import share, snapshot
from agrobot_mj.recording.transport.share import write_shared

PANELS = ("blueprint_panel", "selection_panel", "time_panel")


def unpacked(page, name):
    """Return the content of a compressed part of a page."""
    return gzip.decompress(base64.b64decode(re.search(rf'id="{name}">([^<]*)<', page)[1]))


def test_shared_page_contains_recording_viewer_and_poster(eight, tmp_path):
    poster = tmp_path / "poster.png"
    Image.new("RGB", (8, 4), "red").save(poster)
    written = write_shared(eight.path, tmp_path / "share.html", "A <run>", "completed", poster)
    page = written.read_text(encoding="utf-8")
    assert unpacked(page, "recording") == eight.path.read_bytes()
    assert unpacked(page, "viewer").startswith(b"\0asm")
    assert "class WebHandle" in page
    assert "<title>A &lt;run&gt;</title>" in page
    (image,) = re.findall(r'<img id="poster" alt="" src="data:image/png;base64,([^"]*)"', page)
    assert base64.b64decode(image) == poster.read_bytes()
    assert re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(?!data:)', page) == []


def test_shared_page_opens_only_the_layout_before_the_recording(eight, tmp_path):
    layout = tmp_path / "layout.rrd"
    layout.write_bytes(share.layout(eight.path.read_bytes()))
    command = (*share.RERUN, "rrd", "print", str(layout))
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    entities = {line.split(" - ")[1] for line in shown.splitlines() if line.startswith("Chunk(")}
    assert {name.split("/")[1] for name in entities} == {"viewport", "view", "container", *PANELS}
    assert "BlueprintActivationCommand" in shown
    page = write_shared(eight.path, tmp_path / "share.html", "run", "").read_text(encoding="utf-8")
    assert unpacked(page, "layout") == layout.read_bytes()
    assert page.index('part("layout")') < page.index('part("recording")')


def test_error_for_a_missing_web_viewer_names_the_program(monkeypatch):
    monkeypatch.setattr(share, "RERUN", (sys.executable, "-c", "raise SystemExit(3)"))
    with pytest.raises(OSError, match="the web viewer of rerun-sdk did not start") as caught:
        share.viewer_files()
    assert caught.value.filename == sys.executable


def test_folder_without_recording_cannot_be_shared(call, tmp_path):
    (tmp_path / "metrics.json").write_text("{}", encoding="utf-8")
    status, _, err = call("report", str(tmp_path), "--share")
    assert (status, "contains no recording (run.rrd or comparison.rrd)" in err) == (2, True)
    assert "record with" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


def test_error_for_a_missing_folder_names_the_folder(call, tmp_path):
    status, _, err = call("report", str(tmp_path / "none"), "--share")
    assert (status, f"--share {tmp_path / 'none'}: no such folder" in err) == (2, True)


def test_error_for_a_run_without_recording_gives_the_record_command(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("run", "circle", "--set", "duration_s=0.5", "--no-rrd", "--quiet", "--out", "mine")[0] == 0
    status, _, err = call("report", "mine", "--share")
    fix = "run mine/scenario.toml --out mine"
    assert (status, f"record with: agrobot-mj {fix}" in err, (tmp_path / "mine/run.rrd").exists()) == (2, True, False)
    assert call(*fix.split(), "--quiet")[0] == 0
    assert (tmp_path / "mine/run.rrd").exists()


def test_shared_page_made_without_a_vulkan_driver_has_no_poster(eight, tmp_path, monkeypatch, capsys):
    def refused(*_):
        raise snapshot.SnapshotError("run.rrd: no images")

    given = []
    monkeypatch.setattr(snapshot, "snapshots", refused)
    monkeypatch.setattr(share, "write_shared", lambda *some: given.extend(some) or shutil.copy(some[0], some[1]))
    shutil.copy(eight.path, tmp_path / "run.rrd")
    (tmp_path / "metrics.json").write_text('{"outcome": "stuck", "lateral_rms": 0.031}', encoding="utf-8")
    (tmp_path / "scenario.toml").write_text('name = "mine"\n[guidance]\nkind = "lqr"\n', encoding="utf-8")
    assert [path.name for path in sharing.share(tmp_path / "run.rrd")] == ["share.html"]
    assert given[2:] == ["mine", "stuck, lateral rms 3.1 cm, guidance lqr", None]
    assert "run.rrd: no images; poster.png is not written" in capsys.readouterr().err


def test_video_without_ffmpeg_is_rejected_before_the_viewer_starts(call, eight, tmp_path, monkeypatch):
    monkeypatch.setattr(snapshot.shutil, "which", lambda program: None)
    monkeypatch.chdir(tmp_path)
    status, _, err = call("snapshot", str(eight.path), "--mp4", "--out", "pictures")
    assert (status, "--mp4: ffmpeg is not installed" in err) == (2, True)
    assert list(tmp_path.iterdir()) == []


def test_video_and_animation_options_exclude_each_other(call, eight):
    status, _, err = call("snapshot", str(eight.path), "--mp4", "--gif")
    assert (status, "--gif and --mp4 are mutually exclusive" in err) == (2, True)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg: apt-get install ffmpeg")
def test_video_has_the_requested_frames_and_even_side_lengths(tmp_path):
    frames = [Image.new("RGB", (321, 181), (0, 0, 6 * k)) for k in range(20)]
    video = tmp_path / "video.mp4"
    video.write_bytes(snapshot.as_mp4(frames))
    decode = ("ffmpeg", "-loglevel", "error", "-i", str(video), "-f", "image2pipe", "-c:v", "ppm", "-")
    images = subprocess.run(decode, capture_output=True, check=True).stdout
    size = len(b"P6\n320 180\n255\n") + 3 * 320 * 180
    assert len(images) == 20 * size
    assert Image.open(io.BytesIO(images[-size:])).getpixel((160, 90))[2] == pytest.approx(6 * 19, abs=6)
