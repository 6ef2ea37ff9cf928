// What PCL, nanoflann and a linked octree need for the jobs that `rm3d bench` measures.
// pcl_peer JOB POINTS NORMALS N RADIUS K OUT: POINTS, NORMALS: N rows of three float32 (NORMALS may be '-').
// Prints processor seconds; writes OUT: int32 neighbour counts, float32 descriptor rows or int32 labels.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <string>
#include <vector>

#include <pcl/features/fpfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/features/pfh.h>
#include <pcl/features/shot.h>
#include <pcl/octree/octree_search.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/region_growing.h>
#include <pcl/segmentation/supervoxel_clustering.h>
#if __has_include(<nanoflann.hpp>)
#include <nanoflann.hpp>
#define WITH_NANOFLANN
#endif

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;

static double seconds() { return double(std::clock()) / CLOCKS_PER_SEC; }

template <class T> static void save(const char* name, const std::vector<T>& rows) {
  FILE* file = std::fopen(name, "wb");
  std::fwrite(rows.data(), sizeof(T), rows.size(), file);
  std::fclose(file);
}

static std::vector<float> load(const char* name, size_t count) {
  std::vector<float> values(count);
  FILE* file = std::fopen(name, "rb");
  if (!file || std::fread(values.data(), sizeof(float), count, file) != count) std::exit(2);
  std::fclose(file);
  return values;
}

// Octants that hold the first and the last of a chain of points, with the three rules of Behley et al. (ICRA 2015).
struct LinkedOctree {
  struct Octant { float c[3], half; uint32_t start, size, child[8]; bool leaf; };
  const std::vector<float>& p;
  std::vector<uint32_t> next;
  std::vector<Octant> octants;
  uint32_t bucket;

  LinkedOctree(const std::vector<float>& points, uint32_t bucket) : p(points), next(points.size() / 3), bucket(bucket) {
    float low[3], high[3], centre[3], half = 0;
    for (int a = 0; a < 3; ++a) low[a] = std::numeric_limits<float>::max(), high[a] = -low[a];
    for (size_t i = 0; i < next.size(); ++i) {
      next[i] = i + 1;
      for (int a = 0; a < 3; ++a) low[a] = std::min(low[a], p[3 * i + a]), high[a] = std::max(high[a], p[3 * i + a]);
    }
    for (int a = 0; a < 3; ++a) centre[a] = (low[a] + high[a]) / 2, half = std::max(half, (high[a] - low[a]) / 2);
    uint32_t last;
    divide(centre, half, 0, next.size(), last);
  }

  uint32_t divide(const float* centre, float half, uint32_t start, uint32_t size, uint32_t& last) {
    const uint32_t me = octants.size();
    octants.push_back({{centre[0], centre[1], centre[2]}, half, start, size, {}, size <= bucket || half < 1e-6f});
    if (octants[me].leaf) {
      last = start;
      for (uint32_t i = 1; i < size; ++i) last = next[last];
      return me;
    }
    uint32_t head[8], tail[8], count[8] = {};
    for (uint32_t i = 0, at = start; i < size; ++i) {
      const uint32_t after = next[at];
      const int k = (p[3 * at] > centre[0]) | (p[3 * at + 1] > centre[1]) << 1 | (p[3 * at + 2] > centre[2]) << 2;
      if (count[k]++) next[tail[k]] = at; else head[k] = at;
      tail[k] = at;
      at = after;
    }
    bool first = true;
    for (int k = 0; k < 8; ++k) {
      if (!count[k]) continue;
      const float quarter = half / 2;
      const float at[3] = {centre[0] + (k & 1 ? quarter : -quarter), centre[1] + (k & 2 ? quarter : -quarter),
                           centre[2] + (k & 4 ? quarter : -quarter)};
      uint32_t end;
      const uint32_t child = divide(at, quarter, head[k], count[k], end);
      octants[me].child[k] = child;
      if (first) octants[me].start = octants[child].start; else next[last] = octants[child].start;
      last = end;
      first = false;
    }
    return me;
  }

  bool search(uint32_t at, const float* q, float r, std::vector<uint32_t>& out) const {
    const Octant& o = octants[at];
    float far = 0, sq = r * r;
    for (int a = 0; a < 3; ++a) { const float d = std::abs(q[a] - o.c[a]) + o.half; far += d * d; }
    if (far < sq || o.leaf) {
      uint32_t i = o.start;
      for (uint32_t k = 0; k < o.size; ++k, i = next[i]) {
        const float x = p[3 * i] - q[0], y = p[3 * i + 1] - q[1], z = p[3 * i + 2] - q[2];
        if (far < sq || x * x + y * y + z * z <= sq) out.push_back(i);
      }
    } else {
      for (int k = 0; k < 8; ++k) {
        if (!o.child[k]) continue;
        const Octant& c = octants[o.child[k]];
        float near = 0;
        for (int a = 0; a < 3; ++a) { const float d = std::max(std::abs(q[a] - c.c[a]) - c.half, 0.f); near += d * d; }
        if (near <= sq && search(o.child[k], q, r, out)) return true;
      }
    }
    bool inside = true;
    for (int a = 0; a < 3; ++a) inside = inside && std::abs(q[a] - o.c[a]) + r <= o.half;
    return inside;
  }
};

#ifdef WITH_NANOFLANN
struct Rows {
  const std::vector<float>& p;
  size_t kdtree_get_point_count() const { return p.size() / 3; }
  float kdtree_get_pt(size_t i, size_t d) const { return p[3 * i + d]; }
  template <class B> bool kdtree_get_bbox(B&) const { return false; }
};
#endif

template <class Feature, class Out> static std::vector<float> describe(
    Feature& feature, Points::Ptr cloud, Normals::Ptr normals, double radius, int bins, double& spent) {
  const double begin = seconds();
  pcl::PointCloud<Out> found;
  feature.setInputCloud(cloud);
  feature.setInputNormals(normals);
  feature.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>(false)));
  feature.setRadiusSearch(radius);
  feature.compute(found);
  spent = seconds() - begin;
  std::vector<float> rows;
  for (const auto& row : found)
    for (int i = 0; i < bins; ++i) rows.push_back(reinterpret_cast<const float*>(&row)[i]);
  return rows;
}

int main(int argc, char** argv) {
  if (argc != 8) return 1;
  const std::string job = argv[1];
  const size_t n = std::atoll(argv[4]);
  const double radius = std::atof(argv[5]);
  const int k = std::atoi(argv[6]);
  const char* out = argv[7];
  const std::vector<float> p = load(argv[2], 3 * n);
  std::vector<int32_t> counts(n);
  double begin = seconds(), spent = 0;
  if (job == "linked-octree") {
    LinkedOctree tree(p, 32);
    std::vector<uint32_t> near;
    for (size_t i = 0; i < n; ++i) { near.clear(); tree.search(0, &p[3 * i], radius, near); counts[i] = near.size(); }
    spent = seconds() - begin;
    save(out, counts);
  }
#ifdef WITH_NANOFLANN
  if (job == "nanoflann") {
    Rows rows{p};
    using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Rows>, Rows, 3, uint32_t>;
    Tree tree(3, rows, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    tree.buildIndex();
    std::vector<std::pair<uint32_t, float>> near;
    nanoflann::SearchParams parameters;
    parameters.sorted = false;
    for (size_t i = 0; i < n; ++i)
      counts[i] = tree.radiusSearch(&p[3 * i], float(radius * radius), near, parameters);
    spent = seconds() - begin;
    save(out, counts);
  }
#endif
  Points::Ptr cloud(new Points);
  for (size_t i = 0; i < n; ++i) cloud->emplace_back(p[3 * i], p[3 * i + 1], p[3 * i + 2]);
  Normals::Ptr normals(new Normals);
  if (std::string(argv[3]) != "-") {
    const std::vector<float> rows = load(argv[3], 3 * n);
    for (size_t i = 0; i < n; ++i) normals->emplace_back(rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]);
  }
  begin = seconds();
  if (job == "octree") {
    pcl::octree::OctreePointCloudSearch<pcl::PointXYZ> tree(radius);
    tree.setInputCloud(cloud);
    tree.addPointsFromInputCloud();
    pcl::Indices near;
    std::vector<float> squares;
    for (size_t i = 0; i < n; ++i) counts[i] = tree.radiusSearch((*cloud)[i], radius, near, squares);
    spent = seconds() - begin;
    save(out, counts);
  }
  if (job == "normals") {
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
    Normals found;
    estimation.setInputCloud(cloud);
    estimation.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>(false)));
    estimation.setKSearch(k);
    estimation.compute(found);
    spent = seconds() - begin;
    std::vector<float> rows;
    for (const auto& row : found) rows.insert(rows.end(), {row.normal_x, row.normal_y, row.normal_z});
    save(out, rows);
  }
  if (job == "pfh") {
    pcl::PFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::PFHSignature125> feature;
    save(out, describe<decltype(feature), pcl::PFHSignature125>(feature, cloud, normals, radius, 125, spent));
  }
  if (job == "fpfh") {
    pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> feature;
    save(out, describe<decltype(feature), pcl::FPFHSignature33>(feature, cloud, normals, radius, 33, spent));
  }
  if (job == "shot") {
    pcl::SHOTEstimation<pcl::PointXYZ, pcl::Normal, pcl::SHOT352> feature;
    save(out, describe<decltype(feature), pcl::SHOT352>(feature, cloud, normals, radius, 352, spent));
  }
  if (job == "region-growing") {
    pcl::RegionGrowing<pcl::PointXYZ, pcl::Normal> growing;
    growing.setMinClusterSize(20);
    growing.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>(false)));
    growing.setNumberOfNeighbours(k);
    growing.setInputCloud(cloud);
    growing.setInputNormals(normals);
    growing.setSmoothnessThreshold(std::acos(0.8));
    growing.setCurvatureThreshold(1.0);
    std::vector<pcl::PointIndices> regions;
    growing.extract(regions);
    spent = seconds() - begin;
    std::vector<int32_t> labels(n, -1);
    for (size_t i = 0; i < regions.size(); ++i) for (int at : regions[i].indices) labels[at] = i;
    save(out, labels);
  }
  if (job == "vccs") {  // RADIUS: voxel edge in metres; K: the distance of seeds in voxels
    pcl::PointCloud<pcl::PointXYZRGBA>::Ptr coloured(new pcl::PointCloud<pcl::PointXYZRGBA>);
    for (const auto& q : *cloud) { pcl::PointXYZRGBA c; c.x = q.x; c.y = q.y; c.z = q.z; c.rgba = 0; coloured->push_back(c); }
    begin = seconds();
    pcl::SupervoxelClustering<pcl::PointXYZRGBA> clustering(radius, radius * k);
    clustering.setUseSingleCameraTransform(false);
    clustering.setInputCloud(coloured);
    clustering.setNormalCloud(normals);
    clustering.setColorImportance(0.1f);
    clustering.setSpatialImportance(0.4f);
    clustering.setNormalImportance(1.0f);
    std::map<uint32_t, pcl::Supervoxel<pcl::PointXYZRGBA>::Ptr> found;
    clustering.extract(found);
    const auto labelled = clustering.getLabeledCloud();
    spent = seconds() - begin;
    std::vector<int32_t> labels;
    for (const auto& point : *labelled) labels.push_back(point.label);
    save(out, labels);
  }
  std::printf("%.6f\n", spent);
  return 0;
}
