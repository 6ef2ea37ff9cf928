"""Made-up scenes in the native formats of real data sets; every one says that it is synthetic."""

from rm3d_plugin.datasets.synthetic.kitti_writer import make_streets
from rm3d_plugin.datasets.synthetic.s3dis_writer import make_s3dis_rooms
from rm3d_plugin.datasets.synthetic.scannet_writer import make_scannet_rooms

__all__ = ['make_s3dis_rooms', 'make_scannet_rooms', 'make_streets']
