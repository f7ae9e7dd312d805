"""NMEA sentences of the receiver, and the local tangent plane of their coordinates."""

from math import isnan, pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agrobot_mj.core.agopengps.position import BoardAttitude, decode_position, panda, paogi
from agrobot_mj.core.geodesy import Origin, to_geodetic, to_local
from agrobot_mj.core.nmea import Solution, checksum, degrees_of, fields_of, gga, rmc, vtg

LEUVEN = Solution(0.1, 50.877, 4.699, 35.0, 1.2, 0.0)
NORTHWARD = BoardAttitude(0.0, radians(-2.5), 0.0, radians(-5))


def test_encoded_sentences_equal_the_documented_examples():
    assert panda(LEUVEN, NORTHWARD) == (
        b"$PANDA,120000.10,5052.6200000,N,00441.9400000,E,4,14,0.7,35.000,1.0,2.333,900,-25,0,5*7D\r\n"
    )
    sent = b"$PAOGI,183019.08,5052.6288305,N,00441.9487828,E,4,14,0.7,35.000,1.0,2.916,17.78,0.00,0.0,-4.5*7A\r\n"
    there = Solution(6.5 * 3600 + 19.08, 50 + 52.6288305 / 60, 4 + 41.9487828 / 60, 35.0, 1.5, 0.0)
    assert paogi(there, BoardAttitude(radians(90 - 17.78), 0.0, 0.0, radians(4.5))) == sent
    short = b"$PAOGI,120000.10,5052.6200000,N,00441.9400000,E,4,14,0.7,35.000,1.0,2.333,90.0,-2.50,0.0,0.5*47"
    assert decode_position(short).attitude == pytest.approx((0.0, radians(-2.5), 0.0, radians(-0.5)))


def test_imu_fields_of_sentences_are_integers_even_without_an_imu():
    fields = fields_of(panda(LEUVEN, BoardAttitude()))
    assert fields is not None
    assert fields[12:] == ["65535", "0", "0", "0"]
    for attitude in (BoardAttitude(), NORTHWARD, BoardAttitude(0.01, 0.001, 0.002, 0.003)):
        fields = fields_of(panda(LEUVEN, attitude))
        assert all(fields)
        assert all(field.lstrip("-").isdigit() for field in fields[12:])
    assert all(fields_of(paogi(LEUVEN, BoardAttitude(0.3))))


def test_roll_pitch_and_heading_in_sentences_have_the_correct_signs():
    left_up_nose_down = BoardAttitude(pi / 2, radians(3), radians(2), radians(4))
    fields = fields_of(panda(LEUVEN, left_up_nose_down))
    assert fields[12:] == ["0", "30", "-20", "-4"]


@given(st.floats(-80, 80), st.floats(-179.9, 179.9), st.floats(0, 5), st.floats(-pi, pi), st.floats(-0.5, 0.5))
def test_written_sentences_are_read_back_unchanged(latitude, longitude, speed, yaw, roll):
    solution, attitude = Solution(3723.45, latitude, longitude, 1.5, speed, yaw), BoardAttitude(yaw, roll, -roll, 0.1)
    for write, tolerance in ((panda, radians(0.051)), (paogi, radians(0.0051))):
        found = decode_position(write(solution, attitude))
        assert found.solution.t == pytest.approx(13 * 3600 + 2 * 60 + 3.45)
        assert found.solution.latitude == pytest.approx(latitude, abs=1e-9)
        assert found.solution.longitude == pytest.approx(longitude, abs=1e-9)
        assert found.solution.speed == pytest.approx(speed, abs=5e-4)
        assert (found.attitude.yaw - yaw + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=tolerance)
        assert found.attitude.roll == pytest.approx(roll, abs=tolerance)
        assert found.dual == (write is paogi)


def test_rounded_nmea_minutes_stay_below_sixty():
    text = gga(LEUVEN._replace(latitude=50.9999999999999, longitude=-0.00000000001)).decode()
    assert ",5100.0000000,N,00000.0000000," in text


def test_standard_sentences_equal_the_expected_text():
    assert gga(LEUVEN).startswith(b"$GPGGA,120000.10,5052.6200000,N,00441.9400000,E,4,14,0.7,35.000,M,0.0,M,1.0,0000*")
    assert rmc(LEUVEN).startswith(b"$GPRMC,120000.10,A,5052.6200000,N,00441.9400000,E,2.333,90.00,010626,,,R*")
    assert vtg(LEUVEN).startswith(b"$GPVTG,90.00,T,,M,2.333,N,4.320,K,R*")
    assert all(fields_of(write(LEUVEN)) for write in (gga, rmc, vtg))


def test_sentences_without_gnss_solution_are_flagged_and_empty():
    lost = LEUVEN._replace(quality=0)
    assert fields_of(gga(lost))[2:7] == ["", "", "", "", "0"]
    assert fields_of(rmc(lost))[2:8] == ["V", "", "", "", "", ""]
    assert fields_of(vtg(lost))[9] == "N"


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"$",
        b"$*00",
        b"$PANDA*00\r\n",
        b"\xff" * 40,
        panda(LEUVEN, NORTHWARD).replace(b"900", b"901"),
        gga(LEUVEN),
        panda(LEUVEN, NORTHWARD)[:-6],
    ],
)
def test_invalid_datagram_is_decoded_as_none(datagram):
    assert decode_position(datagram) is None


def test_sentence_with_invalid_fields_is_decoded_as_none():
    good = panda(LEUVEN, NORTHWARD).decode().strip().split("*")[0][1:]
    for field in range(1, 16):
        for nonsense in ("", "x", "nan", "1e999"):
            parts = good.split(",")
            parts[field] = nonsense
            text = ",".join(parts)
            found = decode_position(f"${text}*{checksum(text)}\r\n".encode())
            assert found is None or not isnan(found.solution.latitude + found.solution.longitude)


@given(st.floats(-75, 75), st.floats(-170, 170), st.floats(-2000, 2000), st.floats(-2000, 2000))
def test_conversion_to_local_coordinates_and_back_is_exact(latitude, longitude, east, north):
    origin = Origin(latitude, longitude)
    assert to_local(origin, *to_geodetic(origin, east, north)) == pytest.approx((east, north), abs=1e-6)


@pytest.mark.parametrize(("place", "name"), [(("a", 11), "latitude"), ((48, None), "longitude")])
def test_error_for_a_non_numeric_origin_names_the_argument(place, name):
    with pytest.raises(TypeError, match=f"{name}: must be a number, got"):
        Origin(*place)


def test_local_plane_coordinates_match_the_ellipsoid():
    origin = Origin(50.877, 4.699)
    latitude, longitude = to_geodetic(origin, 500.0, 500.0)
    east, north = _tangent_plane(origin, latitude, longitude)
    assert east == pytest.approx(500.0, abs=0.03)
    assert north == pytest.approx(500.0, abs=0.03)


def _tangent_plane(origin, latitude, longitude):
    """Return east and north in the tangent plane of WGS84, computed from geocentric coordinates."""
    import numpy as np

    a, e2 = 6378137.0, 6.69437999014e-3

    def geocentric(lat, lon):
        phi, lam = np.radians(lat), np.radians(lon)
        n = a / np.sqrt(1 - e2 * np.sin(phi) ** 2)
        return np.array([n * np.cos(phi) * np.cos(lam), n * np.cos(phi) * np.sin(lam), n * (1 - e2) * np.sin(phi)])

    d = geocentric(latitude, longitude) - geocentric(*origin)
    phi, lam = np.radians(origin.latitude), np.radians(origin.longitude)
    east = np.array([-np.sin(lam), np.cos(lam), 0])
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    return float(east @ d), float(north @ d)


def test_latitudes_and_longitudes_of_all_hemispheres_are_read():
    assert degrees_of("5052.6200000", "S") == pytest.approx(-50.877)
    assert degrees_of("00441.9400000", "E") == pytest.approx(4.699)


def test_point_due_east_of_the_origin_has_the_latitude_of_the_origin():
    """At this latitude, the north coordinate in the tangent plane is x^2 tan(latitude) / 2R."""
    origin = Origin(50.877, 4.699)
    _, north = _tangent_plane(origin, *to_geodetic(origin, 500.0, 0.0))
    assert north == pytest.approx(0.0241, abs=0.0003)
