// The same rays through Embree 3, one ray at a time, one thread: what `cargo bench --bench trace -- rays` is compared
// with. Not part of the build; needs Debian's libembree-dev.
//
//   g++ -O3 -march=native benches/trace/embree_rays.cpp -lembree3 -o target/embree_rays
//   LTM_EMBREE=target/embree_rays cargo bench --bench trace -- rays
//
// The benchmark gives it folders of meshes and rays, and reads what it prints. With LTM_RAY_DUMP=target/rays it leaves
// them there instead, for `target/embree_rays target/rays/*`.
#include <embree3/rtcore.h>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

static std::vector<float> read(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
    std::vector<float> values(bytes.size() / 4);
    std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(values.data()));
    return values;
}

int main(int count, char** folders) {
    // As Embree's manual asks of each thread.
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    RTCDevice device = rtcNewDevice("threads=1");
    for (int f = 1; f < count; f++) {
        std::string folder = folders[f];
        std::vector<float> corners = read(folder + "/triangles");
        size_t triangles = corners.size() / 9;
        RTCScene scene = rtcNewScene(device);
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        auto* vertices = static_cast<float*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, triangles * 3));
        std::copy(corners.begin(), corners.end(), vertices);
        auto* indices = static_cast<unsigned*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles));
        for (unsigned i = 0; i < triangles * 3; i++) indices[i] = i;
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        auto begin = std::chrono::steady_clock::now();
        rtcCommitScene(scene);
        std::chrono::duration<double> build = std::chrono::steady_clock::now() - begin;
        printf("%s: %zu triangles, built in %.2f s (quality high)\n", folder.c_str(), triangles, build.count());
        for (std::string set : {"primary", "bounce", "shadow"}) {
            std::vector<float> rays = read(folder + "/" + set);
            size_t n = rays.size() / 7, hits = 0;
            double best = INFINITY;
            for (int repeat = 0; repeat < 7; repeat++) {
                hits = 0;
                RTCIntersectContext context;
                rtcInitIntersectContext(&context);
                if (set != "shadow") context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
                auto start = std::chrono::steady_clock::now();
                for (size_t i = 0; i < n; i++) {
                    const float* r = &rays[7 * i];
                    RTCRayHit query{};
                    query.ray = {r[0], r[1], r[2], 0.0f, r[3], r[4], r[5], 0.0f, r[6], ~0u, 0, 0};
                    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
                    if (set == "shadow") {
                        rtcOccluded1(scene, &context, &query.ray);
                        hits += query.ray.tfar >= 0.0f;
                    } else {
                        rtcIntersect1(scene, &context, &query);
                        hits += query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
                    }
                }
                std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
                best = std::min(best, time.count());
            }
            printf("  %-8s %.3f M rays/s, %zu of %zu %s\n", set.c_str(), n / best / 1e6, hits, n,
                   set == "shadow" ? "clear" : "hit");
        }
        rtcReleaseGeometry(geometry);
        rtcReleaseScene(scene);
    }
    rtcReleaseDevice(device);
}
