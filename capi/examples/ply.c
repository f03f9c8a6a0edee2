/* A host in C11: loads a ply model, asks it in many ways, samples it, holds it to its energy, and looks at errors.
 *
 *     ply [MODEL.pwm]
 *
 * capi/examples/reference.rs prints the same by the Rust library; capi/run_examples.sh compares the two. */
#include <math.h>
#include <plywave.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends the program with the message of a call that failed. */
static void must(PlywaveStatus status, const PlywaveError *error) {
    if (status != PLYWAVE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", plywave_status_name(status), error->message);
        exit(1);
    }
}

static void print(const char *name, const float *values, int count) {
    printf("%s", name);
    for (int k = 0; k < count; ++k) printf(" %.8e", (double)values[k]);
    printf("\n");
}

/* The next of an even sequence of points in the unit cube. */
static void next_u(int i, float u[3]) {
    const double steps[3] = {0.819172513396164, 0.671043606703789, 0.549700477901970};
    for (int k = 0; k < 3; ++k) u[k] = (float)fmod(0.5 + i * steps[k], 1.0);
}

int main(int argc, char **argv) {
    if (plywave_abi_version() != PLYWAVE_ABI_VERSION) {
        fprintf(stderr, "the header is of another version than the library\n");
        return 1;
    }
    PlywaveError error;
    PlywavePly *ply = NULL;
    must(plywave_ply_load(argc > 1 ? argv[1] : "fabrics/models/polyester.pwm", &ply, &error), &error);

    PlywavePlyInfo info;
    must(plywave_ply_info(ply, &info, &error), &error);
    printf("radius %.2f um, edge lobes %d, layer factors %d\n", info.radius_um, info.has_edge, info.has_layers);

    /* A shading point: latitude of the light, offset of the beam, absorptions of red, green and blue. The wavelengths are left at their defaults. */
    PlywavePlyQuery query = {.theta_i = 0.5f, .h_um = 10.0f, .count = 3, .sigma_per_um = {0.001f, 0.004f, 0.010f}};
    PlywaveBsdf bsdf;
    must(plywave_ply_at(ply, &query, &bsdf, &error), &error);

    const float directions[4][3] = {
        {0.0f, 1.0f, 0.0f}, {0.0f, -0.8f, -0.6f}, {0.6f, 0.8f, 0.0f}, {0.48f, -0.64f, 0.6f}};
    for (int i = 0; i < 4; ++i) {
        float f_pdf[4];
        must(plywave_bsdf_eval_pdf(&bsdf, directions[i], f_pdf, &f_pdf[3], &error), &error);
        print("eval", f_pdf, 4);
    }
    float f[4][3], pdf[4];
    must(plywave_bsdf_eval_batch(&bsdf, 4, directions[0], f[0], pdf, &error), &error);
    print("batch", f[0], 12);
    for (int i = 0; i < 4; ++i) {
        PlywaveSample sample;
        float u[3];
        next_u(i, u);
        must(plywave_bsdf_sample(&bsdf, u, &sample, &error), &error);
        print("sample", sample.w, 3);
        print("weight", sample.weight, 3);
    }
    float albedo[3];
    must(plywave_bsdf_albedo(&bsdf, albedo, &error), &error);
    print("albedo", albedo, 3);

    /* White furnace: clear fibers in even light send out all of it. */
    PlywavePlyQuery clear = {.theta_i = 0.5f, .h_um = 10.0f, .count = 1, .lambda_um = {0.55f}};
    must(plywave_ply_at(ply, &clear, &bsdf, &error), &error);
    must(plywave_bsdf_albedo(&bsdf, albedo, &error), &error);
    print("furnace", albedo, 1);
    double sum = 0.0;
    const int samples = 20000;
    for (int i = 0; i < samples; ++i) {
        PlywaveSample sample;
        float u[3];
        next_u(i, u);
        must(plywave_bsdf_sample(&bsdf, u, &sample, &error), &error);
        sum += sample.weight[0];
    }
    printf("sampled furnace %.8e\n", sum / samples);
    if (fabs(sum / samples - 1.0) > 0.01) return 1;

    /* What `plywave check` does, smaller. */
    PlywavePlyReport report;
    must(plywave_ply_check(ply, 3, 2000, 1, &report, &error), &error);
    printf("check: furnace %.8e, weight %.8e, chi-square p %.8e, passed %d\n", report.lobes.furnace_error,
           report.lobes.weight_error, report.lobes.chi2_p, report.passed);

    /* Errors are codes and messages. */
    const float nan_direction[3] = {NAN, 0.0f, 1.0f};
    PlywaveStatus status = plywave_bsdf_eval(&bsdf, nan_direction, f[0], &error);
    printf("%s: %s\n", plywave_status_name(status), error.message);
    PlywavePly *none = NULL;
    status = plywave_ply_load("no such model.pwm", &none, &error);
    printf("%s: %s\n", plywave_status_name(status), error.message);
    if (none != NULL) return 1;

    plywave_ply_free(ply);
    return 0;
}
