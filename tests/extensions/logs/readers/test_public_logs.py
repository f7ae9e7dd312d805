"""The acceptance script distinguishes files read correctly, rejected files, and files read wrongly."""

import public_logs
import pytest
from test_nmea_text import checked

PLACES = [(50.877 + 2e-5 * k, 4.699 + 1e-5 * k) for k in range(12)]


def minutes(value, digits):
    return f"{int(value):0{digits}d}{60 * (value % 1):010.7f}"


@pytest.fixture
def folder(tmp_path):
    rows = [f"{minutes(lat, 2)},N,{minutes(lon, 3)},E" for lat, lon in PLACES]
    rows = [checked(f"$GPGGA,1200{k:02d}.00,{place},1,9,0.9,35.0,M,46.0,M,,") for k, place in enumerate(rows)]
    (tmp_path / "good.log").write_text("\n".join(rows))
    damaged = [row.replace("35.0", "36.0") for row in rows]
    (tmp_path / "damaged.log").write_text("\n".join([*rows, *damaged]))
    pairs = " ".join(f"{lon:.7f},{lat:.7f},0" for lat, lon in PLACES)
    line = f"<Placemark><LineString><coordinates>{pairs}</coordinates></LineString></Placemark>"
    (tmp_path / "way.kml").write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2">{line}</kml>')
    marks = "".join(f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"/>' for lat, lon in PLACES)
    (tmp_path / "track.gpx").write_text(f"<gpx><trk><trkseg>{marks}</trkseg></trk></gpx>")
    (tmp_path / "empty.gpx").write_text("<gpx></gpx>")
    course = checked("$GPRMC,120000.00,A,5052.62000,N,00441.94000,E,fast,0.0,010126,,,A")
    (tmp_path / "course.log").write_text("\n".join([course, *rows]))
    (tmp_path / "notes.txt").write_text("no log\n")
    return tmp_path


def groups(folder):
    return {file.name: public_logs.verdict(file, file.name).group for file in folder.iterdir()}


def test_public_log_check_compares_files_with_expected_positions(folder, capsys):
    assert groups(folder) == {
        "good.log": "read",
        "way.kml": "read",
        "track.gpx": "read",
        "empty.gpx": "read",
        "course.log": "read",
        "damaged.log": "wrongly rejected",
        "notes.txt": "rejected",
    }
    assert public_logs.main([str(folder)]) == 1
    assert "wrongly rejected: damaged.log: " in capsys.readouterr().out
    (folder / "damaged.log").unlink()
    assert public_logs.main([str(folder)]) == 0


def test_public_log_check_detects_displaced_positions_and_reader_errors(folder, monkeypatch):
    read = public_logs.read
    monkeypatch.setattr(public_logs, "read", lambda file: read(file) + 1e-4)
    assert public_logs.verdict(folder / "good.log", "").group == "wrong"
    monkeypatch.setattr(public_logs, "read", lambda file: 1 / 0)
    assert public_logs.verdict(folder / "good.log", "").why.startswith("ZeroDivisionError")
