"""Prints every image of a ROS 2 recording, decoded by its own schema."""
import sys
import zlib

from mcap_ros2.reader import read_ros2_messages

for message in read_ros2_messages(sys.argv[1]):
    image, stamp = message.ros_msg, message.ros_msg.header.stamp
    time = stamp.sec * 10**9 + stamp.nanosec
    size = f"{image.width}x{image.height}"
    crc = zlib.crc32(bytes(image.data))
    print(message.log_time_ns, time, image.header.frame_id, size, image.encoding, image.is_bigendian, image.step, f"{crc:08x}")
