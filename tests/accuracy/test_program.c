/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon accuracy` as it is typed: what it writes, what it refuses. argv[1] is the program. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <libxml/parser.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <yyjson.h>

#include "cts/results.h"

static const char *program;
static char folder[] = "/tmp/gnomon-accuracy-XXXXXX";

static int run(const char *const *arguments)
{
    const char *argv[32] = {program, "accuracy"};
    for (size_t i = 0; arguments[i]; i++)
        argv[i + 2] = arguments[i];
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        int out = open("out.txt", O_WRONLY | O_CREAT | O_TRUNC, 0666);
        int err = open("err.txt", O_WRONLY | O_CREAT | O_TRUNC, 0666);
        dup2(out, 1);
        dup2(err, 2);
        execv(program, (char *const *)(uintptr_t)argv);
        _exit(127);
    }
    int status = 0;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

#define RUN(...) run((const char *const[]){__VA_ARGS__, NULL})

static char *read_all(const char *path, size_t *out_length)
{
    char *data = NULL, error[256];
    if (!gn_file_read(path, 1 << 24, &data, out_length, error, sizeof error))
        fail_msg("%s", error);
    return data;
}

static void expect_text(const char *path, const char *expected)
{
    size_t length;
    char *text = read_all(path, &length);
    if (!strstr(text, expected))
        fail_msg("%s: expected '%s' in: %s", path, expected, text);
    free(text);
}

static const struct {
    const char *key;
    bool text;
} keys[] = {{"scene", true},
            {"rays", true},
            {"mode", true},
            {"tier", true},
            {"mrays_per_s", false},
            {"ratio_to_robust", false},
            {"wrong_per_million", false},
            {"gross_per_million", false},
            {"t_error_ulp_median", false},
            {"t_error_ulp_max", false},
            {"build_seconds", false},
            {"bytes", false}};

static void check_row(yyjson_val *row)
{
    assert_int_equal(yyjson_obj_size(row), sizeof keys / sizeof keys[0]);
    for (size_t k = 0; k < sizeof keys / sizeof keys[0]; k++) {
        yyjson_val *value = yyjson_obj_get(row, keys[k].key);
        if (!value ||
            (keys[k].text ? !yyjson_is_str(value) : !yyjson_is_num(value) && !yyjson_is_null(value)))
            fail_msg("%s: expected %s", keys[k].key, keys[k].text ? "a string" : "a number");
    }
    const char *tier = yyjson_get_str(yyjson_obj_get(row, "tier"));
    double wrong = yyjson_get_num(yyjson_obj_get(row, "wrong_per_million"));
    double gross = yyjson_get_num(yyjson_obj_get(row, "gross_per_million"));
    assert_true(gross >= 0 && gross <= wrong && wrong <= 1e6);
    assert_true(yyjson_get_num(yyjson_obj_get(row, "mrays_per_s")) > 0);
    assert_true(yyjson_get_num(yyjson_obj_get(row, "bytes")) > 0);
    if (strcmp(tier, "robust") == 0)
        assert_true(yyjson_get_num(yyjson_obj_get(row, "ratio_to_robust")) == 1);
    if (strcmp(tier, "certified") == 0 || strcmp(tier, "exact") == 0) {
        if (wrong != 0)
            fail_msg("tier %s: %g wrong decisions per million", tier, wrong);
        /* A t that is right to 2^-40 is right to a few 2^-17 of f32's last place. */
        assert_true(yyjson_get_num(yyjson_obj_get(row, "t_error_ulp_max")) <= 0x1p-14);
    }
}

static void a_quick_run_writes_what_it_says(void **state)
{
    (void)state;
    static const char *const scenes[] = {"terrain",   "terrain-2m", "blob", "slivers",
                                         "instances", "far",        "soup"};
    static const char *const aims[] = {"interior", "edge", "vertex", "random"};
    static const char *const tiers[] = {"fast", "robust", "double", "certified", "exact"};
    int status = RUN("--quick", "--rays", "500", "--runs", "1", "--out", "q", "--budget", "1000x");
    if (status != 0) {
        size_t length;
        fail_msg("expected 0, found %d: %s", status, read_all("err.txt", &length));
    }
    size_t length = 0;
    char *text = read_all("q/accuracy.json", &length);
    yyjson_doc *doc = yyjson_read(text, length, 0);
    assert_non_null(doc);
    yyjson_val *list = yyjson_doc_get_root(doc);
    assert_int_equal(yyjson_arr_size(list), 7 * 4 * 2 * 5);
    double embree_wrong = 0;
    for (size_t i = 0; i < yyjson_arr_size(list); i++) {
        yyjson_val *row = yyjson_arr_get(list, i);
        check_row(row);
        assert_string_equal(yyjson_get_str(yyjson_obj_get(row, "scene")), scenes[i / 40]);
        assert_string_equal(yyjson_get_str(yyjson_obj_get(row, "rays")), aims[i / 10 % 4]);
        assert_string_equal(yyjson_get_str(yyjson_obj_get(row, "mode")), i / 5 % 2 ? "batch" : "single");
        assert_string_equal(yyjson_get_str(yyjson_obj_get(row, "tier")), tiers[i % 5]);
        if (i % 5 == 0)
            embree_wrong += yyjson_get_num(yyjson_obj_get(row, "wrong_per_million"));
    }
    /* A judge that calls everything right is worthless: Embree's default mode loses rays at vertices. */
    assert_true(embree_wrong > 0);
    yyjson_doc_free(doc);
    free(text);

    text = read_all("q/accuracy.svg", &length);
    xmlDocPtr svg = xmlReadMemory(text, (int)length, "accuracy.svg", NULL, XML_PARSE_NONET);
    assert_non_null(svg);
    xmlFreeDoc(svg);
    free(text);
    text = read_all("q/accuracy.png", &length);
    assert_memory_equal(text, "\x89PNG", 4);
    free(text);
    text = read_all("q/accuracy.html", &length);
    assert_non_null(strstr(text, "What is compared"));
    /* Nothing is loaded from anywhere: the only address is the name space of SVG. */
    for (char *at = text; (at = strstr(at, "://")); at += 3)
        assert_memory_equal(at - 4, "http://www.w3.org/2000/svg", 26);
    assert_null(strstr(text, "nan"));
    free(text);
    /* Everything is within this budget, so the choice is the tier that promises most. */
    expect_text("out.txt", "ALL SCENES  single  exact: ");
    text = read_all("out.txt", &length);
    size_t column = 0;
    for (size_t i = 0; i < length; i++) {
        column = text[i] == '\n' ? 0 : column + 1;
        if (column > 100)
            fail_msg("a line longer than 100 columns: %.120s", text + i - 100);
    }
    free(text);
}

/* What the rows of one mode come to for a tier; every kind of rays has as many, but for the exact tier, which errs in none. */
struct sum {
    const char *tier;
    double time, wrong, t_error; /* t_error: 0 below what the judge can tell */
};

static uint32_t sums_of(yyjson_val *list, const char *mode, struct sum out[8])
{
    uint32_t count = 0, rows[8] = {0};
    yyjson_arr_iter all = yyjson_arr_iter_with(list);
    yyjson_val *row;
    while ((row = yyjson_arr_iter_next(&all))) {
        uint32_t s = 0;
        if (strcmp(yyjson_get_str(yyjson_obj_get(row, "mode")), mode) != 0)
            continue;
        while (s < count && strcmp(out[s].tier, yyjson_get_str(yyjson_obj_get(row, "tier"))) != 0)
            s++;
        if (s == count)
            out[count++] = (struct sum){.tier = yyjson_get_str(yyjson_obj_get(row, "tier"))};
        double error = yyjson_get_num(yyjson_obj_get(row, "t_error_ulp_max"));
        rows[s]++;
        out[s].time -= log(yyjson_get_num(yyjson_obj_get(row, "ratio_to_robust")));
        out[s].wrong += yyjson_get_num(yyjson_obj_get(row, "wrong_per_million"));
        out[s].t_error = fmax(out[s].t_error, error > 1e-4 ? error : 0);
    }
    for (uint32_t s = 0; s < count; s++) {
        out[s].time = exp(out[s].time / rows[s]);
        out[s].wrong /= rows[s];
    }
    return count;
}

/* The tiers that no other beats, in the order of their times, as the plot lists them; values within 1e-9 are the same. */
static void front_of(const struct sum *sums, uint32_t count, bool of_t_error, char *out, size_t size)
{
    uint32_t on[8], found = 0;
    for (uint32_t a = 0; a < count; a++) {
        bool beaten = false;
        for (uint32_t b = 0; b < count; b++) {
            double x = of_t_error ? sums[a].t_error : sums[a].wrong, y = of_t_error ? sums[b].t_error : sums[b].wrong;
            beaten = beaten || (sums[b].time < sums[a].time && y <= x + 1e-9 * x) ||
                     (sums[b].time <= sums[a].time && y < x - 1e-9 * x);
        }
        if (!beaten)
            on[found++] = a;
    }
    for (uint32_t i = 0; i < found; i++)
        for (uint32_t j = i + 1; j < found; j++)
            if (sums[on[j]].time < sums[on[i]].time) {
                uint32_t kept = on[i];
                on[i] = on[j];
                on[j] = kept;
            }
    out[0] = 0;
    for (uint32_t i = 0; i < found; i++)
        snprintf(out + strlen(out), size - strlen(out), "%s%s", i ? " " : "", sums[on[i]].tier);
}

/* The choice for a budget and the fronts of the plot, once more from the rows of the JSON alone. */
static void choice_and_front_follow_from_the_rows(void **state)
{
    (void)state;
    static const char *const modes[] = {"single", "batch"};
    static const char *const budgets[] = {"0.7x", "1x", "1.5x", "4x"};
    for (size_t b = 0; b < sizeof budgets / sizeof budgets[0]; b++) {
        assert_int_equal(RUN("--quick", "--rays", "300", "--runs", "1", "--scene", "blob", "--out", "f", "--budget", budgets[b]), 0);
        size_t length;
        char *json = read_all("f/accuracy.json", &length);
        yyjson_doc *doc = yyjson_read(json, length, 0);
        char *svg = read_all("f/accuracy.svg", &length), *at = svg, expected[128];
        assert_non_null(doc);
        struct sum sums[2][8];
        uint32_t count = 0;
        for (int mode = 0; mode < 2; mode++) {
            int choice = -1;
            count = sums_of(yyjson_doc_get_root(doc), modes[mode], sums[mode]);
            assert_int_equal(count, 5);
            for (uint32_t s = 0; s < count; s++) {
                const struct sum *sum = &sums[mode][s], *best = choice < 0 ? NULL : &sums[mode][choice];
                bool same = best && fabs(sum->wrong - best->wrong) <= 1e-9 * best->wrong;
                if (sum->time <= atof(budgets[b]) &&
                    (!best || (!same && sum->wrong < best->wrong) || (same && sum->t_error <= best->t_error)))
                    choice = (int)s;
            }
            if (choice >= 0)
                snprintf(expected, sizeof expected, "%-6s  %s: ", modes[mode], sums[mode][choice].tier);
            else
                snprintf(expected, sizeof expected, "%-6s  no tier takes at most", modes[mode]);
            expect_text("out.txt", expected);
        }
        /* Panels: single rays, batches; above wrong decisions, below the error of t. */
        for (int panel = 0; panel < 4; panel++) {
            front_of(sums[panel % 2], count, panel >= 2, expected, sizeof expected);
            at = strstr(at, "data-tiers=\"");
            assert_non_null(at);
            at += strlen("data-tiers=\"");
            if (strncmp(at, expected, strlen(expected)) != 0 || at[strlen(expected)] != '"')
                fail_msg("panel %d: expected the front \"%s\", found %.40s", panel, expected, at);
        }
        yyjson_doc_free(doc);
        free(json);
        free(svg);
    }
}

static void a_model_file_is_a_scene(void **state)
{
    (void)state;
    FILE *file = fopen("dir tetra.obj", "w");
    assert_non_null(file);
    fputs("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", file);
    fclose(file);
    assert_int_equal(RUN("--quick", "--rays", "200", "--runs", "1", "--scene", "dir tetra.obj", "--scene",
                         "soup", "--threads", "2", "--out", "m"),
                     0);
    expect_text("m/accuracy.json", "\"scene\": \"dir tetra.obj\"");
    expect_text("m/accuracy.json", "\"scene\": \"soup\"");
    expect_text("out.txt", "dir tetra.obj: a model file of 1 mesh and 1 instance; 4 triangles");
}

/* A real driver on a small scene: rows of every setting, those that only build differently alike in their answers. */
static void a_driver_is_measured(void **state)
{
    (void)state;
    int status = RUN("--quick", "--rays", "300", "--runs", "1", "--scene", "terrain", "--driver", "lavapipe", "--out", "d");
    size_t length = 0;
    if (status != 0)
        fail_msg("expected 0, found %d: %s", status, read_all("err.txt", &length));
    char *text = read_all("d/accuracy.json", &length);
    yyjson_doc *doc = yyjson_read(text, length, 0);
    yyjson_val *list = yyjson_doc_get_root(doc), *row;
    yyjson_arr_iter all = yyjson_arr_iter_with(list);
    uint32_t rows = 0, f32_rows = 0;
    double coarse = 0, fine = 0, beyond = 0;
    while ((row = yyjson_arr_iter_next(&all))) {
        const char *setting = yyjson_get_str(yyjson_obj_get(row, "setting"));
        if (!setting)
            continue;
        rows++;
        assert_int_equal(yyjson_obj_size(row), 15);
        assert_true(yyjson_get_num(yyjson_obj_get(row, "mrays_per_s")) > 0);
        assert_true(yyjson_get_num(yyjson_obj_get(row, "build_seconds")) > 0);
        assert_true(yyjson_get_num(yyjson_obj_get(row, "bytes")) > 0);
        assert_int_equal(yyjson_is_null(yyjson_obj_get(row, "update_seconds")),
                         strncmp(setting, "re", 2) != 0);
        double error = yyjson_get_num(yyjson_obj_get(row, "t_error_ulp_median"));
        bool format = strcmp(yyjson_get_str(yyjson_obj_get(row, "group")), "format") == 0;
        coarse = format && error > coarse ? error : coarse;
        fine = !format && error > fine ? error : fine;
        f32_rows += !format;
        if (strcmp(yyjson_get_str(yyjson_obj_get(row, "rays")), "interior") == 0)
            beyond += yyjson_get_num(yyjson_obj_get(row, "beyond_bound_per_million"));
    }
    assert_int_equal(rows, 11 * 4);
    assert_int_equal(f32_rows, 9 * 4);
    /* 16 bits per coordinate cost accuracy of what was meant, and are no fault of the driver. */
    if (!(coarse > 4 * fine) || beyond != 0)
        fail_msg("formats: t to %g ulp, f32: to %g; beyond the bound: %g", coarse, fine, beyond);
    yyjson_doc_free(doc);
    free(text);
    expect_text("d/accuracy.html", "The driver: time against error");
    expect_text("out.txt", "refitted_far");
}

/* The levels of the layer that was built beside the program, on a real driver. */
static void the_layer_is_measured(void **state)
{
    (void)state;
    static const char *const levels[] = {"off", "state", "state+shaders"};
    int status = RUN("--quick", "--rays", "200", "--runs", "1", "--scene", "soup", "--layer", "--out", "l");
    size_t length = 0;
    if (status != 0)
        fail_msg("expected 0, found %d: %s", status, read_all("err.txt", &length));
    char *text = read_all("l/accuracy.json", &length);
    yyjson_doc *doc = yyjson_read(text, length, 0);
    yyjson_arr_iter all = yyjson_arr_iter_with(yyjson_doc_get_root(doc));
    yyjson_val *row;
    uint32_t counts[3] = {0};
    while ((row = yyjson_arr_iter_next(&all))) {
        const char *level = yyjson_get_str(yyjson_obj_get(row, "level"));
        if (!level)
            continue;
        assert_int_equal(yyjson_obj_size(row), 4);
        assert_true(yyjson_is_str(yyjson_obj_get(row, "workload")));
        assert_true(yyjson_get_num(yyjson_obj_get(row, "seconds")) > 0);
        double ratio = yyjson_get_num(yyjson_obj_get(row, "ratio_to_off"));
        assert_true(strcmp(level, "off") == 0 ? ratio == 1 : ratio > 0);
        for (size_t i = 0; i < 3; i++)
            counts[i] += strcmp(level, levels[i]) == 0;
    }
    /* A level that had something to say of a valid application would be left out. */
    for (size_t i = 0; i < 3; i++)
        if (counts[i] < 10 || counts[i] != counts[0])
            fail_msg("%s: %u workloads, without a layer %u", levels[i], counts[i], counts[0]);
    yyjson_doc_free(doc);
    free(text);
    expect_text("l/accuracy.html", "The layer: what its levels cost");
}

static void wrong_usage_is_refused(void **state)
{
    (void)state;
    FILE *file = fopen("bad.obj", "w");
    assert_non_null(file);
    fputs("v 0 0 0\nf 1 2 3\n", file);
    fclose(file);
    const struct {
        const char *arguments[6];
        const char *expected;
    } rows[] = {
        {{"--scene", "teapot"}, "there is no scene 'teapot'; there are terrain"},
        {{"--scene", "missing.ply"}, "missing.ply: No such file"},
        {{"--quick", "--scene", "soup", "--scene", "bad.obj"}, "bad.obj: line 2: the face names vertex 2"},
        {{"--budget", "fast"}, "--budget: expected a factor"},
        {{"--rays", "0"}, "--rays: expected a whole number"},
        {{"--runs", "4"}, "--runs: expected an odd number"},
        {{"--driver", "missing_icd.json"}, "missing_icd.json"},
        {{"terrain"}, "a scene is named by --scene"},
        {{"--nonsense"}, "--nonsense"},
        {{"--quick", "--scene", "soup", "--out", "bad.obj"}, "bad.obj"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int status = run(rows[i].arguments);
        if (status != 2)
            fail_msg("row %zu: expected exit status 2, found %d", i, status);
        expect_text("err.txt", rows[i].expected);
    }
}

static int setup(void **state)
{
    (void)state;
    return mkdtemp(folder) && chdir(folder) == 0 ? 0 : -1;
}

static int teardown(void **state)
{
    (void)state;
    char command[300];
    snprintf(command, sizeof command, "rm -rf -- '%s'", folder);
    return chdir("/") == 0 ? system(command) : -1;
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_quick_run_writes_what_it_says),
        cmocka_unit_test(choice_and_front_follow_from_the_rows),
        cmocka_unit_test(a_model_file_is_a_scene),
        cmocka_unit_test(a_driver_is_measured),
        cmocka_unit_test(the_layer_is_measured),
        cmocka_unit_test(wrong_usage_is_refused),
    };
    if (argc < 2)
        return 2;
    program = argv[1];
    return cmocka_run_group_tests(tests, setup, teardown);
}
