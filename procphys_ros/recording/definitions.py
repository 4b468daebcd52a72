# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Definitions of the messages that are recorded, as text that travels inside the recording.

They are those of ROS 2 Jazzy (common_interfaces, rcl_interfaces; Apache-2.0), without comments.
"""

_SEPARATOR = '\n' + 80 * '=' + '\n'

_HEADER = 'std_msgs/Header header\n'
_FIELDS = {
    'builtin_interfaces/Duration': 'int32 sec\nuint32 nanosec',
    'builtin_interfaces/Time': 'int32 sec\nuint32 nanosec',
    'geometry_msgs/Point': 'float64 x\nfloat64 y\nfloat64 z',
    'geometry_msgs/Pose': 'geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation',
    'geometry_msgs/PoseArray': f'{_HEADER}geometry_msgs/Pose[] poses',
    'geometry_msgs/Quaternion': 'float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1',
    'geometry_msgs/Vector3': 'float64 x\nfloat64 y\nfloat64 z',
    'geometry_msgs/Vector3Stamped': f'{_HEADER}geometry_msgs/Vector3 vector',
    'geometry_msgs/Wrench': 'geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque',
    'geometry_msgs/WrenchStamped': f'{_HEADER}geometry_msgs/Wrench wrench',
    'rosgraph_msgs/Clock': 'builtin_interfaces/Time clock',
    'sensor_msgs/CompressedImage': f'{_HEADER}string format\nuint8[] data',
    'sensor_msgs/PointCloud2': (
        f'{_HEADER}uint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n'
        'bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense'),
    'sensor_msgs/PointField': (
        'uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\n'
        'uint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n'
        'string name\nuint32 offset\nuint8 datatype\nuint32 count'),
    'std_msgs/ColorRGBA': 'float32 r\nfloat32 g\nfloat32 b\nfloat32 a',
    'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id',
    'std_msgs/String': 'string data',
    'visualization_msgs/Marker': (
        'int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\n'
        'int32 LINE_LIST=5\nint32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\n'
        'int32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\nint32 TRIANGLE_LIST=11\n'
        'int32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\nint32 DELETEALL=3\n'
        f'{_HEADER}string ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n'
        'geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n'
        'builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n'
        'std_msgs/ColorRGBA[] colors\nstring texture_resource\n'
        'sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\n'
        'string text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\n'
        'bool mesh_use_embedded_materials'),
    'visualization_msgs/MarkerArray': 'visualization_msgs/Marker[] markers',
    'visualization_msgs/MeshFile': 'string filename\nuint8[] data',
    'visualization_msgs/UVCoordinate': 'float32 u\nfloat32 v',
}
KINDS = ('geometry_msgs/msg/PoseArray', 'geometry_msgs/msg/Vector3Stamped',
         'geometry_msgs/msg/WrenchStamped', 'rosgraph_msgs/msg/Clock',
         'sensor_msgs/msg/PointCloud2', 'std_msgs/msg/String',
         'visualization_msgs/msg/MarkerArray')


def definition(kind: str) -> str:
    """
    Return the definition of a message with those of all nested ones (encoding `ros2msg`).

    :param kind: one of `KINDS`.
    """
    name = kind.replace('/msg/', '/')
    order = [name]
    for outer in order:  # grows during the loop
        for line in _FIELDS[outer].splitlines():
            inner = line.split()[0].removesuffix('[]')
            if inner in _FIELDS and inner not in order:
                order.append(inner)
    return _SEPARATOR.join([_FIELDS[name], *(f'MSG: {inner}\n{_FIELDS[inner]}'
                                             for inner in order[1:])])
