/* The same rays through Embree 3: robust, one thread, in its single-ray and its coherent 16-wide mode. Rays come as
 * structures of arrays; their number is a multiple of 16. */
#include <embree3/rtcore.h>
#include <stddef.h>
#include <string.h>

struct tracer {
    RTCDevice device;
    RTCScene scene;
};

struct rays {
    const float *origin[3];
    const float *direction[3];
    size_t count;
};

int embree_build(struct tracer *tracer, const float *vertices, size_t vertex_count, const unsigned *triangles,
                 size_t triangle_count)
{
    tracer->device = rtcNewDevice("threads=2");
    if (!tracer->device)
        return 0;
    tracer->scene = rtcNewScene(tracer->device);
    rtcSetSceneFlags(tracer->scene, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry mesh = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    float *v = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, vertex_count);
    unsigned *t = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangle_count);
    if (!v || !t)
        return 0;
    memcpy(v, vertices, 12 * vertex_count);
    memcpy(t, triangles, 12 * triangle_count);
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(tracer->scene, mesh);
    rtcReleaseGeometry(mesh);
    rtcCommitScene(tracer->scene);
    return rtcGetDeviceError(tracer->device) == RTC_ERROR_NONE;
}

void embree_free(struct tracer *tracer)
{
    rtcReleaseScene(tracer->scene);
    rtcReleaseDevice(tracer->device);
}

void embree_single(const struct tracer *tracer, const struct rays *rays, float *t, unsigned *ids)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (size_t i = 0; i < rays->count; i++) {
        struct RTCRayHit r;
        r.ray.org_x = rays->origin[0][i];
        r.ray.org_y = rays->origin[1][i];
        r.ray.org_z = rays->origin[2][i];
        r.ray.dir_x = rays->direction[0][i];
        r.ray.dir_y = rays->direction[1][i];
        r.ray.dir_z = rays->direction[2][i];
        r.ray.tnear = 0.0f;
        r.ray.time = 0.0f;
        r.ray.tfar = __builtin_inff();
        r.ray.mask = ~0u;
        r.ray.flags = 0;
        r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        r.hit.primID = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(tracer->scene, &context, &r);
        t[i] = r.ray.tfar;
        ids[i] = r.hit.primID;
    }
}

void embree_coherent(const struct tracer *tracer, const struct rays *rays, float *t, unsigned *ids)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    static const _Alignas(64) int valid[16] = {-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};
    struct RTCRayHit16 r;
    for (int l = 0; l < 16; l++) {
        r.ray.tnear[l] = 0.0f;
        r.ray.time[l] = 0.0f;
        r.ray.mask[l] = ~0u;
        r.ray.flags[l] = 0;
    }
    for (size_t i = 0; i < rays->count; i += 16) {
        memcpy(r.ray.org_x, rays->origin[0] + i, 64);
        memcpy(r.ray.org_y, rays->origin[1] + i, 64);
        memcpy(r.ray.org_z, rays->origin[2] + i, 64);
        memcpy(r.ray.dir_x, rays->direction[0] + i, 64);
        memcpy(r.ray.dir_y, rays->direction[1] + i, 64);
        memcpy(r.ray.dir_z, rays->direction[2] + i, 64);
        for (int l = 0; l < 16; l++) {
            r.ray.tfar[l] = __builtin_inff();
            r.hit.geomID[l] = RTC_INVALID_GEOMETRY_ID;
            r.hit.primID[l] = RTC_INVALID_GEOMETRY_ID;
        }
        rtcIntersect16(valid, tracer->scene, &context, &r);
        memcpy(t + i, r.ray.tfar, 64);
        memcpy(ids + i, r.hit.primID, 64);
    }
}
