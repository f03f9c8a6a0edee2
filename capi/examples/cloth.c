// A cloth file in C11: loaded, evaluated, sampled, its energy, and what bad files are answered.
//
//     cloth CLOTH.pwc OTHER
//
// CLOTH.pwc is made by `plywave weave CLOTH.toml -o CLOTH.pwc`; OTHER is any other file.
#include <math.h>
#include <plywave.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// Numbers in [0, 1): a generator of 32 bits.
static uint32_t state = 1;
static float uniform(void) {
    state = 1664525u * state + 1013904223u;
    return (float)(state >> 8) / 16777216.0f;
}

static void check(PlywaveStatus status, const PlywaveError *error) {
    if (status == PLYWAVE_STATUS_OK) return;
    fprintf(stderr, "%s: %s\n", plywave_status_name(status), error->message);
    exit(1);
}

// What a call that must be refused has left: a status, no cloth, one line.
static void refused(const char *what, PlywaveStatus status, PlywaveCloth *const *cloth, const PlywaveError *error) {
    if (status == PLYWAVE_STATUS_OK || *cloth != NULL || strchr(error->message, '\n') != NULL) {
        fprintf(stderr, "%s: not refused in one line\n", what);
        exit(1);
    }
    printf("%-16s %s\n", what, plywave_status_name(status));
}

static uint8_t *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) return NULL;
    long length = ftell(file);
    rewind(file);
    uint8_t *bytes = malloc((size_t)length);
    *size = bytes == NULL ? 0 : fread(bytes, 1, (size_t)length, file);
    fclose(file);
    return bytes;
}

// Light that clear fibers send on, of a view from a random place: all of it, on average.
static double energy(const PlywaveCloth *cloth, int n, double *samples) {
    PlywaveError error;
    double sum = 0.0;
    *samples = 0.0;
    for (int i = 0; i < n; ++i) {
        float z = 0.2f + 0.8f * uniform(), phi = 6.2831853f * uniform(), r = sqrtf(1.0f - z * z);
        PlywaveClothQuery query = {0};
        query.position_um[0] = 1e4f * uniform();
        query.position_um[1] = 1e4f * uniform();
        query.wo[0] = r * cosf(phi), query.wo[1] = r * sinf(phi), query.wo[2] = z;
        query.count = 1;
        query.lambda_um[0] = 0.55f;
        PlywaveBsdf bsdf;
        check(plywave_cloth_at(cloth, &query, &bsdf, &error), &error);
        float albedo, straight, u[3] = {uniform(), uniform(), uniform()};
        check(plywave_bsdf_albedo(&bsdf, &albedo, &error), &error);
        check(plywave_bsdf_straight(&bsdf, &straight, &error), &error);
        sum += (double)albedo + straight;
        PlywaveSample s;
        check(plywave_bsdf_sample(&bsdf, u, &s, &error), &error);
        *samples += s.weight[0] / n;
    }
    return sum / n;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: cloth CLOTH.pwc OTHER\n");
        return 2;
    }
    PlywaveError error;
    PlywaveCloth *cloth = NULL;
    check(plywave_cloth_load(argv[1], NULL, &cloth, &error), &error);
    PlywaveClothInfo info;
    check(plywave_cloth_info(cloth, &info, &error), &error);
    char name[256], notes[2048];
    check(plywave_cloth_name(cloth, name, sizeof name, NULL, &error), &error);
    check(plywave_cloth_notes(cloth, notes, sizeof notes, NULL, &error), &error);
    printf("%s: cell (%.1f, %.1f) x (%.1f, %.1f) um, %.0f um thick, kinds of yarns: %d, far view: %s%s\n", name,
           info.cell_um[0][0], info.cell_um[0][1], info.cell_um[1][0], info.cell_um[1][1], 2.0 * info.half_thickness_um,
           info.kinds, info.has_far ? "yes" : "no", notes);

    // RGB at a point, and as the mean over a pixel of 5 mm.
    float light[3] = {0.0f, 0.6f, 0.8f};
    for (int far = 0; far < 2; ++far) {
        PlywaveClothQuery query = {.position_um = {120.0f, 40.0f}, .wo = {0.0f, 0.0f, 1.0f}, .count = 3, .channels = PLYWAVE_CHANNELS_LINEAR_SRGB};
        query.footprint_um = far ? 5000.0f : 0.0f;
        PlywaveBsdf bsdf;
        float f[3], pdf;
        check(plywave_cloth_at(cloth, &query, &bsdf, &error), &error);
        check(plywave_bsdf_eval_pdf(&bsdf, light, f, &pdf, &error), &error);
        printf("%-16s f = %.4f %.4f %.4f, pdf = %.4f\n", far ? "mean" : "point", f[0], f[1], f[2], pdf);
    }

    // Clear fibers keep all light.
    PlywaveClothOptions clear = {0};
    clear.has_sigma = 1;
    PlywaveCloth *furnace = NULL;
    check(plywave_cloth_load(argv[1], &clear, &furnace, &error), &error);
    double samples, sum = energy(furnace, 4000, &samples);
    printf("%-16s %.3f, by samples %.3f\n", "clear fibers", sum, samples);
    if (fabs(sum - 1.0) > 0.04 || fabs(samples - 1.0) > 0.06) {
        fprintf(stderr, "light is lost or made\n");
        return 1;
    }
    plywave_cloth_free(furnace);
    plywave_cloth_free(cloth);

    // Bad files: another one, a truncated one, one of another version.
    size_t size = 0;
    uint8_t *bytes = read_file(argv[1], &size);
    if (bytes == NULL || size < 400) return 1;
    refused("another file", plywave_cloth_load(argv[2], NULL, &cloth, &error), &cloth, &error);
    refused("truncated", plywave_cloth_from_memory(bytes, size / 2, "half", NULL, &cloth, &error), &cloth, &error);
    const char *version = "version\\\":";
    size_t digit = 0;
    for (size_t i = 0; i + strlen(version) < 400; ++i)
        if (memcmp(bytes + i, version, strlen(version)) == 0) digit = i + strlen(version);
    if (digit == 0) {
        fprintf(stderr, "no version in the head of %s\n", argv[1]);
        return 1;
    }
    bytes[digit] = '9';
    refused("another version", plywave_cloth_from_memory(bytes, size, "newer", NULL, &cloth, &error), &cloth, &error);
    free(bytes);
    return 0;
}
