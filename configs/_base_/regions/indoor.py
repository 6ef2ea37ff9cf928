# How points become regions and regions merge (METHOD 3, 5, 6), with lengths for rooms at 1 to 5 cm between points.
_base_ = './points.py'
descriptor = dict(type='AdaptedPFH', radius=0.1)
oversegmenter = dict(type='RegionGrowing', zeta=0.015, max_color_step=0.2)
max_gap = 0.1  # m between adjacent regions
merge = dict(rounds='${rounds}', centre_distance=0.3)  # m
propagation = dict(_delete_=True, max_color=0.45, max_extent=3.0, new_instances=False)
region_prior = dict(_delete_=True, gamma=0.6)
