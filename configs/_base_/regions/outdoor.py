# How the points of streets become regions and regions merge (METHOD 3, 5, 6). The ground, which has classes too, is cut into
# squares; what stands on it grows. How many of the first labels are right on real scans: docs/RESULTS.md.
_base_ = './points.py'
descriptor = dict(type='AdaptedPFH', radius=0.4, range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='GroundPatches',
    cell='${ground_cell}',
    rest=dict(
        type='RegionGrowing',
        threshold=0.9,
        zeta=0.02,
        min_region=10,
        max_edge='${region_reach}',
        range_growth='${region_reach_growth}',
    ),
)
ground_cell = 1.5  # m; smaller where ground has many classes
region_reach = 0.3  # m between points of a region, at the sensor
region_reach_growth = 0.01  # m a metre of range, where the sensor is known
max_gap = 0.6  # m between adjacent regions
merge = dict(rounds='${rounds}', centre_distance=1.0)  # m
region_prior = dict(
    _delete_=True,
    gamma=0.6,
    classifier='kernel',  # a lidar sees all scans from one place, and as many points of each class may be annotated
    distance_scale=1.0,  # m: small things of a class stand anywhere
)
