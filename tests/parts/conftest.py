import pytest
from parts.layout import HAS_MMDET3D, STAND_INS, mmdet3d_layout


@pytest.fixture(params=['stand-ins', 'mmdet3d'])
def layout(request):
    """Classes laid out as mmdetection3d's: stand-ins, and the real ones where they are installed."""
    if request.param == 'stand-ins':
        return STAND_INS
    if not HAS_MMDET3D:
        pytest.skip('mmdet3d is not installed (make mmdet3d)')
    return mmdet3d_layout()
