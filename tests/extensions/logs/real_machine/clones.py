"""A clone with synthetic logs of the riding tractor's form: a bicycle without slip, under the owner's guidance."""

import subprocess
from datetime import UTC, datetime, timedelta
from math import cos, degrees, radians, sin, tan

import numpy as np
from riding_tractor.closed_loop import WHEELBASE_M, Board, Pursuit
from riding_tractor.logs import Repository

LATITUDE, LONGITUDE = 40.4856, -80.3324
BEGIN = datetime(2026, 8, 4, 16, 0, tzinfo=UTC)
ROW_S = 0.05
BRAKING = 0.5
"""Change of speed [m/s2]."""
STRAIGHT, SCALE = 432.0, 0.15
"""True reading straight ahead [counts], and scale [deg per count]."""
FIELD = (
    "time,trans_mode,steer_current,steer_left_pwm,steer_right_pwm,lat,lon,fix_quality,heading_deg,head_valid,carrier,"
    "speed_mps,diff_age"
)
PURSUIT = (
    "timestamp,waypoints_total,pos_x_m,pos_y_m,waypoint_idx,target_x_m,target_y_m,heading_compass_deg,yt_m,delta_deg,"
    "driving,wait_reason"
)


def clone(folder, files):
    """A repository with these files, by path, at its one commit."""
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    git = ("git", "-C", str(folder), "-c", "user.name=test", "-c", "user.email=test@example.org")
    for command in (("init", "-q"), ("add", "-A"), ("commit", "-q", "-m", "logs")):
        subprocess.run((*git, *command), check=True, capture_output=True)
    head = subprocess.run((*git, "rev-parse", "HEAD"), check=True, capture_output=True, text=True).stdout.strip()
    return Repository(folder, "https://example.org/logs", head)


def geodetic(x, y):
    """Latitude and longitude of a place, to 1e-5 minutes as the receiver writes them."""
    step = 1e-5 / 60
    north, east = LATITUDE + y / 111.04e3, LONGITUDE + x / (111.32e3 * cos(radians(LATITUDE)))
    return step * round(north / step), step * round(east / step)


class Drive:
    """A tractor without slip under the owner's guidance, and what both loggers write of it."""

    def __init__(self, waypoints, straight=STRAIGHT, heading_error=0.0, speed=0.5, tight=40.0):
        self.pursuit, self.straight, self.heading_error, self.speed = Pursuit(waypoints), straight, heading_error, speed
        self.pot, self.t, self.lost, self.field, self.guidance = straight, 0.0, {}, [], []
        (self.x, self.y), self.yaw, self.tight, self.u = waypoints[0, :2], 0.0, tight, speed

    def run(self, seconds):
        """Drive on; `lost` says of which times the quality is another or the heading not valid, and then it rests."""
        for _ in range(round(seconds / ROW_S)):
            quality = next((q for (a, b), q in self.lost.items() if a <= self.t < b), "RTK Fixed")
            drives = quality == "RTK Fixed"
            measured = self.yaw + radians(self.heading_error)
            pursuit, angle = self.pursuit.after(self.x, self.y, measured)
            self.pursuit = pursuit if drives else self.pursuit
            board = Board()
            wanted = board.wanted(angle if drives else 0.0)
            reach = self.tight * ROW_S / SCALE
            self.pot += min(max(wanted - self.pot, -reach), reach)
            self._write(quality, drives, degrees(measured), degrees(angle))
            change = BRAKING * ROW_S
            self.u += min(max((self.speed if drives else 0.0) - self.u, -change), change)
            u = self.u
            self.yaw += u * tan(radians(SCALE * (self.pot - self.straight))) / WHEELBASE_M * ROW_S
            self.x, self.y = self.x + u * cos(self.yaw) * ROW_S, self.y + u * sin(self.yaw) * ROW_S
            self.t += ROW_S

    def _write(self, quality, drives, heading, angle):
        lat, lon = geodetic(self.x, self.y)
        stamp = (BEGIN + timedelta(seconds=self.t)).isoformat(timespec="milliseconds")
        word = "none" if quality == "Invalid" else "fixed"
        steering = f"{self.pot:.0f},0,0,{lat:.10f},{lon:.10f}"
        self.field.append(f"{stamp},0,{steering},{quality},{(90 - heading) % 360:.4f},True,{word},{self.u:.3f},1.0")
        target, p = self.pursuit.waypoints[self.pursuit.index], self.pursuit
        where = f"{self.x:.4f},{self.y:.4f},{p.index},{target[0]},{target[1]},{(90 - heading) % 360:.3f},0.0"
        reason = "" if drives else f"fix_quality='{quality}' below --min-fix 'RTK Fixed'"
        seconds = BEGIN.timestamp() + self.t
        self.guidance.append(f"{seconds:.3f},{len(p.waypoints)},{where},{angle:.3f},{drives},{reason}")

    @property
    def field_csv(self):
        return "\n".join((FIELD, *self.field)) + "\n"

    @property
    def pursuit_csv(self):
        return "\n".join((PURSUIT, ",".join("words" for _ in PURSUIT.split(",")), *self.guidance)) + "\n"


def line(length, step=0.49, lookahead=2.0):
    """Waypoints eastwards."""
    x = np.arange(0.0, length, step)
    return np.column_stack((x, np.zeros_like(x), np.full_like(x, lookahead)))
