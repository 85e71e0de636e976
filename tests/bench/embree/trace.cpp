// Times Embree on triangles and rays that `cargo bench --bench embree` wrote, on one thread, and compares what it finds.
//
// File: u32 n_triangles, f32[9] each; u32 n_rays, f32[7] each (origin, direction, expected parameter; infinity = nothing).
// Prints: million rays per second one by one, in packets of 8, in packets of 16, in streams of 64; greatest difference, share of rays that differ.
#include <embree3/rtcore.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <vector>

struct GivenRay { float origin[3], direction[3], expected; };

static std::vector<GivenRay> rays;

static double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The least time of several passes, so that what else the machine does matters little.
template <class Pass> static double least_seconds(Pass pass) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 9; ++i) {
    double start = now();
    pass();
    least = std::fmin(least, now() - start);
  }
  return least;
}

static RTCRayHit hit_of(const GivenRay& ray) {
  RTCRayHit hit = {};
  hit.ray.org_x = ray.origin[0], hit.ray.org_y = ray.origin[1], hit.ray.org_z = ray.origin[2];
  hit.ray.dir_x = ray.direction[0], hit.ray.dir_y = ray.direction[1], hit.ray.dir_z = ray.direction[2];
  hit.ray.tfar = std::numeric_limits<float>::infinity();
  hit.ray.mask = ~0u;
  hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  return hit;
}

// All rays in packets of N, filled within the time that counts.
template <class Hit, uint32_t N, class Intersect>
static void in_packets(RTCScene scene, RTCIntersectContext& context, std::vector<float>& found, Intersect intersect) {
  alignas(64) int valid[N];
  uint32_t n_rays = uint32_t(rays.size());
  for (uint32_t first = 0; first < n_rays; first += N) {
    Hit hit = {};
    for (uint32_t k = 0; k < N; ++k) {
      valid[k] = first + k < n_rays ? -1 : 0;
      const GivenRay& ray = rays[valid[k] ? first + k : first];
      hit.ray.org_x[k] = ray.origin[0], hit.ray.org_y[k] = ray.origin[1], hit.ray.org_z[k] = ray.origin[2];
      hit.ray.dir_x[k] = ray.direction[0], hit.ray.dir_y[k] = ray.direction[1], hit.ray.dir_z[k] = ray.direction[2];
      hit.ray.tfar[k] = std::numeric_limits<float>::infinity();
      hit.ray.mask[k] = ~0u;
      hit.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
    }
    intersect(valid, scene, &context, &hit);
    for (uint32_t k = 0; k < N && first + k < n_rays; ++k) found[first + k] = hit.ray.tfar[k];
  }
}

int main(int argc, char** argv) {
  std::FILE* file = argc > 1 ? std::fopen(argv[1], "rb") : nullptr;
  uint32_t n_triangles = 0, n_rays = 0;
  if (!file || std::fread(&n_triangles, 4, 1, file) != 1) return 2;
  RTCDevice device = rtcNewDevice("threads=1");
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
  RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  void* corners = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3ul * n_triangles);
  uint32_t* indices =
      (uint32_t*)rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, n_triangles);
  if (std::fread(corners, 36, n_triangles, file) != n_triangles) return 2;
  for (uint32_t i = 0; i < 3 * n_triangles; ++i) indices[i] = i;
  rtcCommitGeometry(mesh);
  rtcAttachGeometry(scene, mesh);
  rtcCommitScene(scene);
  if (std::fread(&n_rays, 4, 1, file) != 1) return 2;
  rays.resize(n_rays);
  if (std::fread(rays.data(), sizeof(GivenRay), n_rays, file) != n_rays) return 2;
  std::fclose(file);

  std::vector<float> found(n_rays);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  double single = least_seconds([&] {
    for (uint32_t i = 0; i < n_rays; ++i) {
      RTCRayHit hit = hit_of(rays[i]);
      rtcIntersect1(scene, &context, &hit);
      found[i] = hit.ray.tfar;
    }
  });
  double packets_of_8 = least_seconds([&] { in_packets<RTCRayHit8, 8>(scene, context, found, rtcIntersect8); });
  double packets_of_16 = least_seconds([&] { in_packets<RTCRayHit16, 16>(scene, context, found, rtcIntersect16); });
  double streams = least_seconds([&] {
    RTCRayHit hits[64];
    for (uint32_t first = 0; first < n_rays; first += 64) {
      uint32_t n = n_rays - first < 64 ? n_rays - first : 64;
      for (uint32_t k = 0; k < n; ++k) hits[k] = hit_of(rays[first + k]);
      rtcIntersect1M(scene, &context, hits, n, sizeof(RTCRayHit));
      for (uint32_t k = 0; k < n; ++k) found[first + k] = hits[k].ray.tfar;
    }
  });
  double greatest = 0;
  uint32_t n_differ = 0;
  for (uint32_t i = 0; i < n_rays; ++i) {
    if (std::isinf(found[i]) && std::isinf(rays[i].expected)) continue;
    double difference = std::fabs(found[i] - rays[i].expected);
    if (difference > 0.01) ++n_differ;  // edges: which side a ray passes is the last bit's doing
    else greatest = std::fmax(greatest, difference);
  }
  std::printf("%.3f %.3f %.3f %.3f %.6f %.6f\n", n_rays / single / 1e6, n_rays / packets_of_8 / 1e6,
              n_rays / packets_of_16 / 1e6, n_rays / streams / 1e6, greatest, double(n_differ) / n_rays);
}
