"""URDFs drawn in text: a cart with a LiDAR, in which any part can be changed."""

from pathlib import Path

SCAN = "<horizontal><samples>{beams}</samples><min_angle>{first}</min_angle><max_angle>{last}</max_angle></horizontal>"
BODY = '<box size="0.5 0.4 0.2"/>'


def joint(child: str, parent: str, xyz: str = "0 0 0", rpy: str = "0 0 0", kind: str = "fixed") -> str:
    """A joint and its child link, which has no shape."""
    return (
        f'<link name="{child}"/><joint name="{child}_joint" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/></joint>'
    )


def sensor(
    link: str = "laser",
    name: str = "front",
    *,
    kind: str = "ray",
    beams: int = 271,
    first: float = -2.0,
    last: float = 2.0,
    more: str = "",
    inside: str = "",
) -> str:
    """Gazebo's tags of a LiDAR; inside: in its rays, more: beside them."""
    rays = "lidar" if "lidar" in kind else "ray"
    scan = SCAN.format(beams=beams, first=first, last=last)
    return (
        f'<gazebo reference="{link}"><sensor type="{kind}" name="{name}"><update_rate>20</update_rate>{more}<{rays}>'
        f"<scan>{scan}{inside}</scan><range><min>0.1</min><max>12.0</max></range>"
        f"<noise><type>gaussian</type><stddev>0.02</stddev></noise></{rays}></sensor></gazebo>"
    )


DRIVE = (
    '<gazebo><plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">'
    "<max_linear_velocity>1.5</max_linear_velocity><min_linear_velocity>-0.5</min_linear_velocity>"
    "<max_angular_velocity>2.5</max_angular_velocity><max_linear_acceleration>1.2</max_linear_acceleration>"
    "<max_angular_acceleration>3.5</max_angular_acceleration><frame_id>odom</frame_id></plugin></gazebo>"
)


def urdf(
    *,
    body: str = BODY,
    at: str = "-0.1 0 0.1",
    laser: str = joint("laser", "plate", "0.2 0.05 0.1"),
    tags: str = sensor(),
    more: str = "",
    drive: str = DRIVE,
) -> str:
    """A cart: base_footprint, base_link on it, on that a plate and its LiDAR; a wheel."""
    collision = f'<collision><origin xyz="{at}"/><geometry>{body}</geometry></collision>'
    return (
        f'<?xml version="1.0"?>\n<robot name="cart"><link name="base_footprint"/><link name="base_link">{collision}'
        '</link><joint name="base_joint" type="fixed"><parent link="base_footprint"/><child link="base_link"/>'
        f'<origin xyz="0 0 0.05"/></joint>{joint("plate", "base_link", "0.05 0 0.2")}{laser}'
        '<link name="wheel"><collision><geometry><cylinder radius="0.05" length="0.04"/></geometry></collision></link>'
        '<joint name="wheel_joint" type="continuous"><parent link="base_link"/><child link="wheel"/>'
        f'<origin xyz="0 0.18 0" rpy="1.5707963 0 0"/><axis xyz="0 0 1"/></joint>{tags}{drive}{more}</robot>\n'
    )


def write(path: Path, text: str) -> Path:
    """The file."""
    path.write_text(text)
    return path
