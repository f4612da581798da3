"""Small stand-ins for ROS description packages, in the form of their macros: arms that read YAML files by xacro.

The shapes of the YAML files are those of Universal_Robots_ROS2_Description and franka_description; the lengths of the
arms are made up.
"""

from __future__ import annotations

from collections.abc import Callable

Text = Callable[[str], str]

UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
UR_PLACES = (
    '<origin xyz="0 0 0.16" rpy="0 0 0"/>',
    '<origin xyz="0 0 0" rpy="1.570796327 0 0"/>',
    '<origin xyz="-0.425 0 0" rpy="0 0 0"/>',
    '<origin xyz="-0.39 0 0.13" rpy="0 0 0"/>',
    '<origin xyz="0 -0.1 0" rpy="1.570796327 0 0"/>',
    '<origin xyz="0 0.1 0" rpy="1.570796326589793 3.141592653589793 3.141592653589793"/>',
)
LIMIT = '<limit lower="-6" upper="6" effort="150" velocity="3"/>'


def ur_arm(inertial: Text, dynamics: Text, prefix: str = "", head: str = "") -> str:
    """An arm with the names of ur_description; `inertial` and `dynamics` give elements by link and joint."""
    lines = [
        f'<robot name="ur5e"{head}<link name="{prefix}base_link"/>',
        f'<link name="{prefix}base_link_inertia"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="4"/>'
        '<inertia ixx="0.0044333316" ixy="0" ixz="0" iyy="0.0044333316" iyz="0" izz="0.0072"/></inertial></link>',
        f'<joint name="{prefix}base" type="fixed"><parent link="{prefix}base_link"/>'
        f'<child link="{prefix}base_link_inertia"/></joint>',
    ]
    parent = "base_link_inertia"
    for link, joint, place in zip(UR_LINKS, UR_JOINTS, UR_PLACES, strict=True):
        offset = {"upper_arm": "0.138", "forearm": "0.007"}.get(link, "0")
        lines += [
            f'<link name="{prefix}{link}_link"><visual><origin xyz="0 0 {offset}" rpy="0 0 0"/>'
            f'<geometry><box size="0.1 0.1 0.1"/></geometry></visual>{inertial(link)}</link>',
            f'<joint name="{prefix}{joint}_joint" type="revolute"><parent link="{prefix}{parent}"/>'
            f'<child link="{prefix}{link}_link"/>{place}<axis xyz="0 0 1"/>{LIMIT}{dynamics(joint)}</joint>',
        ]
        parent = f"{link}_link"
    lines += [
        f'<link name="{prefix}tool0"/><joint name="{prefix}tool" type="fixed"><parent link="{prefix}wrist_3_link"/>'
        f'<child link="{prefix}tool0"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines)


HEAD = """ xmlns:xacro="http://www.ros.org/wiki/xacro">
"""


def ur_package(physical: str, dynamics: str, prefix: str = "") -> str:
    """The arm that reads physical parameters and joint dynamics."""
    loads = f"""<xacro:property name="inertia" value="${{xacro.load_yaml('{physical}')['inertia_parameters']}}"/>
<xacro:property name="offsets" value="${{xacro.load_yaml('{physical}')['offsets']}}"/>
<xacro:property name="dynamics" value="${{xacro.load_yaml('{dynamics}')['joint_dynamics']}}"/>
"""

    def inertial(link: str) -> str:
        cog, turn, tensor = (
            f"inertia['center_of_mass']['{link}_cog']",
            f"inertia['rotation']['{link}']",
            f"inertia['tensor']['{link}']",
        )
        rows = " ".join(f"""{key}="${{{tensor}['{key}']}}\"""" for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        return (
            f"""<inertial><mass value="${{inertia['{link}_mass']}}"/>"""
            f"""<origin xyz="${{{cog}['x']}} ${{{cog}['y']}} ${{{cog}['z']}}" """
            f"""rpy="${{{turn}['roll']}} ${{{turn}['pitch']}} ${{{turn}['yaw']}}"/><inertia {rows}/></inertial>"""
        )

    def friction(joint: str) -> str:
        each = f"dynamics['{joint}_joint']"
        return f"""<dynamics damping="${{{each}['damping']}}" friction="${{{each}['friction']}}"/>"""

    return ur_arm(inertial, friction, prefix, HEAD + loads)


def franka_arm(inertial: Text, dynamics: Text, head: str = ">") -> str:
    """An arm with the names of franka_description and a hand of its own."""
    lines = [f'<robot name="fr3"{head}<link name="fr3_link0">{inertial("link0")}</link>']
    turns = ("0 0 0", "-1.570796326794897 0 0", "1.570796326794897 0 0", "1.570796326794897 0 0")
    turns += ("-1.570796326794897 0 0", "1.570796326794897 0 0", "1.570796326794897 0 0")
    places = ("0 0 0.333", "0 0 0", "0 -0.316 0", "0.0825 0 0", "-0.0825 0.384 0", "0 0 0", "0.088 0 0")
    for i, (place, turn) in enumerate(zip(places, turns, strict=True), 1):
        lines += [
            f'<link name="fr3_link{i}">{inertial(f"link{i}")}</link>',
            f'<joint name="fr3_joint{i}" type="revolute"><parent link="fr3_link{i - 1}"/>'
            f'<child link="fr3_link{i}"/><origin xyz="{place}" rpy="{turn}"/><axis xyz="0 0 1"/>'
            f'<limit lower="-2.7" upper="2.7" effort="87" velocity="2"/>{dynamics(f"joint{i}")}</joint>',
        ]
    lines += [
        '<link name="fr3_hand"><inertial><origin xyz="0 0 0.03"/><mass value="0.3"/>'
        '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.0025" iyz="0" izz="0.0017"/></inertial></link>',
        '<joint name="fr3_hand_joint" type="fixed"><parent link="fr3_link7"/><child link="fr3_hand"/>'
        '<origin xyz="0 0 0.107" rpy="0 0 -0.785398163397448"/></joint></robot>',
    ]
    return "\n".join(lines)


def franka_package(inertials: str, dynamics: str) -> str:
    """The arm that reads inertials and dynamics."""
    loads = f"""<xacro:property name="inertials" value="${{xacro.load_yaml('{inertials}')}}"/>
<xacro:property name="config" value="${{xacro.load_yaml('{dynamics}')}}"/>
"""

    def inertial(link: str) -> str:
        each = f"inertials['{link}']"
        rows = " ".join(
            f"""i{key}="${{{each}['inertia']['{key}']}}\"""" for key in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        return (
            f"""<inertial><origin rpy="${{{each}['origin']['rpy']}}" xyz="${{{each}['origin']['xyz']}}"/>"""
            f"""<mass value="${{{each}['mass']}}"/><inertia {rows}/></inertial>"""
        )

    def friction(joint: str) -> str:
        keys = ("D", "K", "damping", "friction", "mu_coulomb", "mu_viscous")
        rows = " ".join(f"""{key}="${{config['{joint}']['dynamic']['{key}']}}\"""" for key in keys)
        return f"<dynamics {rows}/>"

    return franka_arm(inertial, friction, HEAD + loads)


def described(mass: float = 2.0) -> Text:
    """An inertia like that of a description, another one for each link, with turned axes."""

    def inertial(link: str) -> str:
        k = sum(map(ord, link)) % 7
        return (
            f'<inertial><origin xyz="0.01 {0.01 * k} 0.05" rpy="{0.3 * (k % 2)} 0 0"/>'
            f'<mass value="{mass + 0.3 * k}"/>'
            '<inertia ixx="0.03" ixy="0.001" ixz="0" iyy="0.02" iyz="0.002" izz="0.015"/></inertial>'
        )

    return inertial


def frictionless(_: str) -> str:
    return ""
