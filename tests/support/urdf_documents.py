"""URDF documents that several tests share."""

# A branched robot: a world above the base, origins with all three angles, a fixed joint within, a
# continuous joint, an axis that is not quite a unit vector, a flange with a gripper that mimics.
BRANCHED = """<?xml version="1.0" encoding="UTF-8"?>
<!-- an arm with a gripper -->
<robot name="branched" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <link name="base_link">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="50"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1.5"/>
    </inertial>
    <visual><geometry><mesh filename="file:///etc/passwd" scale="1 1 1"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="flange"/>
  <link name="finger_a"/><link name="finger_b"/><link name="tag"/><link name="camera"/>
  <joint name="world_joint" type="floating">
    <parent link="world"/><child link="base_link"/><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>
  </joint>
  <joint name="j2" type="continuous">
    <parent link="l1"/><child link="l2"/>
    <origin xyz="0.3 -0.1 0.7" rpy="-1.1 0.4 2.9"/><axis xyz="0.26726 -0.53452 0.80178"/>
  </joint>
  <joint name="j1" type="revolute">
    <parent link="base_link"/><child link="l1"/>
    <origin xyz="0.1 0.2 0.4" rpy="0.3 1.5707963267948966 -0.7"/><axis xyz="0 0 -1"/>
    <limit lower="-3.1" upper="2.9" effort="100" velocity="2"/>
  </joint>
  <joint name="spacer" type="fixed">
    <parent link="l2"/><child link="l3"/><origin rpy="0.5 -0.6 0.7" xyz=" .1  2.e-1 -3E-1 "/>
    <axis xyz="0 0 0"/>
  </joint>
  <joint name="j3" type="revolute">
    <parent link="l3"/><child link="l4"/><origin xyz="0 0 0.2"/>
    <limit upper="1.5" effort="1" velocity="1"/>
    <calibration rising="0.0"/><dynamics damping="0.1"/><safety_controller k_velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="l4"/><child link="flange"/><origin xyz="0 0.1 0" rpy="1 2 3"/>
  </joint>
  <joint name="grip_a" type="prismatic">
    <parent link="flange"/><child link="finger_a"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/>
  </joint>
  <joint name="grip_b" type="prismatic">
    <parent link="flange"/><child link="finger_b"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/><mimic joint="grip_a" multiplier="-1"/>
  </joint>
  <joint name="tag" type="planar"><parent link="l1"/><child link="tag"/></joint>
  <joint name="camera" type="fixed"><parent link="l2"/><child link="camera"/></joint>
  <transmission name="t1"><joint name="j1"/><actuator name="m"/></transmission>
  <gazebo reference="l1"><plugin name="p" filename="evil.so"/></gazebo>
</robot>
"""


JOINT = (
    '<joint name="j1" type="revolute"><parent link="a"/><child link="b"/>'
    '<origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>'
)
LINKS = '<link name="a"/><link name="b"/>'
SMALL = f'<robot name="r">{LINKS}{JOINT}</robot>'


def robot_of(*content: str) -> str:
    return f'<robot name="r">{"".join(content)}</robot>'


def changed(old: str, new: str) -> str:
    """Return the small robot with one thing changed."""
    assert old in SMALL
    return SMALL.replace(old, new)


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>{more}</joint>'
    )


def serial(count: int, kind: str = "revolute") -> str:
    links = [f'<link name="l{i}"/>' for i in range(1, count)]
    names = ["a", *(f"l{i}" for i in range(1, count)), "b"]
    joints = [joint(f"j{i}", names[i], names[i + 1], kind) for i in range(count)]
    return robot_of(LINKS, *links, *joints)
