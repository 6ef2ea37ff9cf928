"""Made-up scenes in the native formats of real data sets; every one says that it is synthetic."""

from rm3d_plugin.datasets.synthetic.kitti_writer import make_streets

__all__ = ['make_streets']
