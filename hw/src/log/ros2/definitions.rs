//! Definitions of ROS 2's messages, as its interface packages have them, without comments.

/// A message's type and its definition, those of its fields' types behind it.
pub(super) struct Definition {
    pub name: &'static str,
    pub text: &'static str,
}

macro_rules! definition {
    ($name:literal, $own:literal $(, $part:ident)*) => {
        Definition { name: $name, text: concat!($own $(, $part!())*) }
    };
}

macro_rules! time {
    () => {
        "================================================================================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    };
}
macro_rules! header {
    () => {
        "================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    };
}
macro_rules! region {
    () => {
        "================================================================================\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    };
}
macro_rules! point_field {
    () => {
        "================================================================================\nMSG: sensor_msgs/PointField\nuint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    };
}
macro_rules! transform_stamped {
    () => {
        "================================================================================\nMSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n================================================================================\nMSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n================================================================================\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n================================================================================\nMSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"
    };
}
macro_rules! layout {
    () => {
        "================================================================================\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n================================================================================\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
    };
}

pub(super) const JOINT_STATE: Definition = definition!(
    "sensor_msgs/msg/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    header,
    time
);
pub(super) const IMAGE: Definition = definition!(
    "sensor_msgs/msg/Image",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
    header,
    time
);
pub(super) const CAMERA_INFO: Definition = definition!(
    "sensor_msgs/msg/CameraInfo",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
    region,
    header,
    time
);
pub(super) const POINT_CLOUD: Definition = definition!(
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
    point_field,
    header,
    time
);
pub(super) const TRANSFORMS: Definition = definition!(
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/TransformStamped[] transforms\n",
    transform_stamped,
    header,
    time
);
pub(super) const TEXT: Definition = definition!("std_msgs/msg/String", "string data\n");
pub(super) const NUMBERS: Definition = definition!(
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    layout
);
pub(super) const LOG: Definition = definition!(
    "rcl_interfaces/msg/Log",
    "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
    time
);
