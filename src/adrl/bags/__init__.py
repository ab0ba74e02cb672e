"""ROS recordings without ROS: bags of ROS 1, and of ROS 2 in both storage formats. Needs the extra `bags`."""

from adrl.bags.reader import Bag, open_bag
from adrl.bags.writer import BagWriter, require_new_bag

__all__ = ["Bag", "BagWriter", "open_bag", "require_new_bag"]
