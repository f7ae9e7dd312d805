"""Keep a ROS 2 node on this computer.

ROS's own setting for that, ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, decides with whom a node talks, but Fast DDS still
opens its ports on all interfaces. A profile that allows one UDP transport, on 127.0.0.1, with peers sought there by
unicast, opens none beyond loopback; nodes with ROS's default settings on the same computer are found all the same.
`python -m agrobot_mj.extensions.links.ros2.profile` prints it, for programs beside the tractor.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError

MIDDLEWARE = "rmw_fastrtps_cpp"
"""The middleware that the profile is for."""
PEERS = 32
"""Participants on this computer that are sought [-]."""
PROFILE = f"""<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>loopback</transport_id>
        <type>UDPv4</type>
        <maxInitialPeersRange>{PEERS}</maxInitialPeersRange>
        <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="loopback_only" is_default_profile="true">
      <rtps>
        <builtin>
          <metatrafficUnicastLocatorList>
            <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
          </metatrafficUnicastLocatorList>
          <initialPeersList>
            <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
          </initialPeersList>
        </builtin>
        <userTransports><transport_id>loopback</transport_id></userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
      </rtps>
    </participant>
  </profiles>
</dds>
"""


@contextmanager
def loopback_only() -> Iterator[None]:
    """Nodes made within the block listen on loopback alone. Raises `ScenarioError` for another middleware.

    To be entered before rclpy is initialised: Fast DDS reads its profile once in a process.
    """
    other = os.environ.get("RMW_IMPLEMENTATION", MIDDLEWARE)
    if other != MIDDLEWARE:
        raise ScenarioError(
            f"RMW_IMPLEMENTATION={other}: cannot be restricted to this computer; unset it or add --network"
        )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "loopback.xml"
        file.write_text(PROFILE, encoding="utf-8")
        wanted = {
            "RMW_IMPLEMENTATION": MIDDLEWARE,
            "FASTDDS_DEFAULT_PROFILES_FILE": str(file),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        }
        left_out = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS", "ROS_LOCALHOST_ONLY")
        before = {key: os.environ.pop(key, None) for key in (*wanted, *left_out)}
        os.environ.update(wanted)
        try:
            yield
        finally:
            for key, value in before.items():
                os.environ.pop(key, None)
                if value is not None:
                    os.environ[key] = value


if __name__ == "__main__":
    print(PROFILE, end="")
