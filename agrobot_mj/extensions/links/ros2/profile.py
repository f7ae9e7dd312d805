"""Restriction of a ROS 2 node to this computer.

With ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, Fast DDS still opens its ports on all interfaces. A profile with one UDP
transport and unicast discovery on 127.0.0.1 opens ports on the loopback interface only. Nodes with default settings on
the same computer are still discovered. `python -m agrobot_mj.extensions.links.ros2.profile` prints the profile for
other programs on this computer.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError

MIDDLEWARE = "rmw_fastrtps_cpp"  # ROS middleware to which the profile applies
PEERS = 32  # Maximum number of participants that can be discovered on this computer
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
    """Restrict the nodes created in a `with` block to the loopback interface.

    The block must begin before rclpy is initialised, because Fast DDS reads its profile once per process. Raises
    `ScenarioError` for another middleware.
    """
    other = os.environ.get("RMW_IMPLEMENTATION", MIDDLEWARE)
    if other != MIDDLEWARE:
        raise ScenarioError(
            f"RMW_IMPLEMENTATION={other}: ROS 2 cannot be restricted to this computer; unset the variable or add "
            "--network"
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
