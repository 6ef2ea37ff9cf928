"""Networks that describe places: they say vectors of sites, no classes."""

from rm3d_plugin.models.descriptors.descriptor_network import DescriptorNetwork, DescriptorOutput
from rm3d_plugin.models.descriptors.predator import PredatorNetwork, PredatorOutput

__all__ = ['DescriptorNetwork', 'DescriptorOutput', 'PredatorNetwork', 'PredatorOutput']
