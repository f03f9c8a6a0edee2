// Embree's curves: time to build their BVH and to find a ray's first hit, on one thread.
//
// strands CURVES.txt NAME RAYS.f32 [NAME RAYS.f32]...: B-spline curves as Mitsuba's text (x y z radius a line, an empty line between curves); rays as six 32-bit floats each.
// Prints for round and flat curves, and for each file of rays: its name, millions of rays a second of this thread's processor time (best of three), hits, and the mean distance.
#if EMBREE == 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <string>
#include <sys/types.h>
#include <vector>

static double clock_s() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

int main(int argc, char** argv) {
    if (argc < 4) return std::fprintf(stderr, "strands CURVES.txt NAME RAYS.f32...\n"), 2;
    std::vector<float> points;
    std::vector<unsigned> firsts;
    std::ifstream text(argv[1]);
    std::string line;
    unsigned count = 0;
    auto end_curve = [&] {
        const unsigned n = unsigned(points.size() / 4);
        for (unsigned k = n - count; count >= 4 && k + 3 < n; ++k) firsts.push_back(k);
        count = 0;
    };
    while (std::getline(text, line)) {
        float v[4];
        if (std::sscanf(line.c_str(), "%f %f %f %f", v, v + 1, v + 2, v + 3) == 4) {
            points.insert(points.end(), v, v + 4);
            ++count;
        } else {
            end_curve();
        }
    }
    end_curve();
    RTCDevice device = rtcNewDevice("threads=1");
    static ssize_t bytes = 0;
    rtcSetDeviceMemoryMonitorFunction(
        device, [](void*, ssize_t more, bool) { return bytes += more, true; }, nullptr);
    for (const bool round : {true, false}) {
        RTCScene scene = rtcNewScene(device);
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
        RTCGeometry curves = rtcNewGeometry(
            device, round ? RTC_GEOMETRY_TYPE_ROUND_BSPLINE_CURVE : RTC_GEOMETRY_TYPE_FLAT_BSPLINE_CURVE);
        void* vertices = rtcSetNewGeometryBuffer(
            curves, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4, 16, points.size() / 4);
        std::copy(points.begin(), points.end(), static_cast<float*>(vertices));
        void* indices = rtcSetNewGeometryBuffer(curves, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT, 4, firsts.size());
        std::copy(firsts.begin(), firsts.end(), static_cast<unsigned*>(indices));
        rtcCommitGeometry(curves);
        rtcAttachGeometry(scene, curves);
        const ssize_t before = bytes;
        const double begun = clock_s();
        rtcCommitScene(scene);
        std::printf("Embree %s, %zu segments: BVH in %.2f s of one thread, %.1f MB\n", round ? "round" : "flat",
                    firsts.size(), clock_s() - begun, 1e-6 * double(bytes - before));
        for (int a = 2; a + 1 < argc; a += 2) {
            std::ifstream file(argv[a + 1], std::ios::binary);
            std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
            const float* rays = reinterpret_cast<const float*>(bytes.data());
            const size_t n = bytes.size() / 24;
            double best = std::numeric_limits<double>::infinity();
            size_t hits = 0;
            double sum = 0;
            for (int turn = 0; turn < 3; ++turn) {
                hits = 0, sum = 0;
                const double from = clock_s();
                for (size_t k = 0; k < n; ++k) {
#if EMBREE != 4
                    RTCIntersectContext context;
                    rtcInitIntersectContext(&context);
#endif
                    RTCRayHit ray{};
                    ray.ray.org_x = rays[6 * k], ray.ray.org_y = rays[6 * k + 1], ray.ray.org_z = rays[6 * k + 2];
                    ray.ray.dir_x = rays[6 * k + 3], ray.ray.dir_y = rays[6 * k + 4], ray.ray.dir_z = rays[6 * k + 5];
                    ray.ray.tfar = std::numeric_limits<float>::infinity();
                    ray.ray.mask = unsigned(-1);
                    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
#if EMBREE == 4
                    rtcIntersect1(scene, &ray);
#else
                    rtcIntersect1(scene, &context, &ray);
#endif
                    if (ray.hit.geomID != RTC_INVALID_GEOMETRY_ID) ++hits, sum += ray.ray.tfar;
                }
                best = std::fmin(best, clock_s() - from);
            }
            std::printf("  rays %s: %.2f M/s, %zu hits, mean distance %.4f\n", argv[a], 1e-6 * double(n) / best, hits,
                        sum / double(hits));
        }
        rtcReleaseGeometry(curves);
        rtcReleaseScene(scene);
    }
    rtcReleaseDevice(device);
}
