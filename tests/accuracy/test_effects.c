/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon effects` as it is typed: what scenes and cases call for, and that nothing else runs. argv[1] is the program. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <yyjson.h>

static const char *program;

/* What the program writes on stdout, malloc'ed. */
static char *run(const char *arguments, int *out_status)
{
    char command[1024], *text = calloc(1, 1 << 20);
    snprintf(command, sizeof command, "'%s' effects %s 2>&1", program, arguments);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    assert_non_null(text);
    size_t length = fread(text, 1, (1 << 20) - 1, pipe);
    text[length] = 0;
    int status = pclose(pipe);
    *out_status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return text;
}

static void what_is_called_for(void **state)
{
    (void)state;
    static const struct {
        const char *arguments, *called, *why;
    } rows[] = {
        {"terrain", "", "one opaque mesh calls for nothing"},
        {"terrain --mask 0x0F", "", "all bits of the instance are set: no mask below 0 hides it"},
        {"terrain --mask 0", " mask", "a mask of 0 hides everything"},
        {"terrain --flags cull-back", " face-culling", "culling by the side that is seen"},
        {"terrain --flags opaque", "", "the ray itself says what is opaque"},
        {"terrain --flags no-opaque,cull-opaque", " any-hit", "culling by opacity has to look at it"},
        {"instances", " mirroring instance-transforms", "every second one is mirrored"},
        {"query.stability.box.flat", " any-hit aabbs", "boxes that are not opaque: the hit says so"},
        {"stability.instance.mirrored", " mask face-culling mirroring instance-transforms", "a case has flags of its own"},
        {"stability.far.instance", " mask instance-transforms", "rotations far away, each for the rays of its own mask"},
        {"stability.geometry.read_back", " geometry-transforms", "one instance in its place"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char arguments[256], called[256] = "";
        int status;
        snprintf(arguments, sizeof arguments, "--quick --json --rays 100 %s", rows[i].arguments);
        char *text = run(arguments, &status);
        if (status != 0)
            fail_msg("%s: expected 0, found %d: %s", rows[i].arguments, status, text);
        yyjson_doc *doc = yyjson_read(text, strlen(text), 0);
        assert_non_null(doc);
        yyjson_val *root = yyjson_doc_get_root(doc), *list = yyjson_obj_get(root, "effects"), *row;
        assert_int_equal(yyjson_arr_size(list), 7);
        assert_true(yyjson_get_uint(yyjson_obj_get(root, "rays")) >= 100);
        assert_int_equal(yyjson_get_uint(yyjson_obj_get(yyjson_obj_get(root, "all_forced"), "answers_changed")), 0);
        yyjson_arr_iter all = yyjson_arr_iter_with(list);
        while ((row = yyjson_arr_iter_next(&all))) {
            const char *name = yyjson_get_str(yyjson_obj_get(row, "effect"));
            bool is_called = yyjson_get_bool(yyjson_obj_get(row, "called"));
            uint64_t ran = yyjson_get_uint(yyjson_obj_get(row, "ran"));
            if (is_called)
                snprintf(called + strlen(called), sizeof called - strlen(called), " %s", name);
            if (!is_called && ran)
                fail_msg("%s: %s ran %llu times", rows[i].arguments, name, (unsigned long long)ran);
            assert_true(yyjson_get_str(yyjson_obj_get(row, "why"))[0] != 0);
            assert_string_equal(yyjson_get_str(yyjson_obj_get(row, "stage")), "trace");
            assert_int_equal(yyjson_get_uint(yyjson_obj_get(row, "answers_changed")), 0);
            /* What some ray does not call for has been forced on it, and timed. */
            bool timed = yyjson_get_uint(yyjson_obj_get(row, "rays_forced")) > 0;
            assert_int_equal(timed, yyjson_is_num(yyjson_obj_get(row, "trace_ratio")));
            assert_true(is_called || timed);
        }
        if (strcmp(called, rows[i].called) != 0)
            fail_msg("%s: expected to call for '%s', found '%s': %s", rows[i].arguments, rows[i].called, called, rows[i].why);
        yyjson_doc_free(doc);
        free(text);
    }
}

static void the_table_is_for_people(void **state)
{
    (void)state;
    int status;
    char *text = run("--quick --rays 100 blob", &status);
    assert_int_equal(status, 0);
    assert_non_null(strstr(text, "every instance's mask has a bit of the ray's 0xff"));
    assert_non_null(strstr(text, "called for"));
    assert_null(strstr(text, "nan"));
    free(text);
}

static void wrong_usage_is_refused(void **state)
{
    (void)state;
    static const struct {
        const char *arguments, *expected;
    } rows[] = {{"", "expected a SCENE"},
                {"teapot", "there is no scene 'teapot'"},
                {"missing.ply", "missing.ply: No such file"},
                {"terrain blob", "a second one: 'blob'"},
                {"--flags shiny terrain", "there is no ray flag 'shiny'"},
                {"--mask 300 terrain", "--mask"},
                {"--mask 1 stability.box.flat", "a case has rays of its own"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int status;
        char *text = run(rows[i].arguments, &status);
        if (status != 2 || !strstr(text, rows[i].expected))
            fail_msg("%s: expected 2 and '%s', found %d: %s", rows[i].arguments, rows[i].expected, status, text);
        free(text);
    }
}

/* A model in a folder of its own, `effects --light` of it without a driver, and what that says. */
static char *light(const char *name, const char *model, int *out_status)
{
    char folder[] = "/tmp/gnomon-light-XXXXXX", arguments[256], path[64], command[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(model, file);
    fclose(file);
    snprintf(arguments, sizeof arguments,
             "--light --driver none --no-curves --runs 1 --width 120 --height 90 --samples 2 --depth 3 --out %s/page %s", folder,
             path);
    char *text = run(arguments, out_status);
    snprintf(command, sizeof command, "rm -r %s", folder);
    assert_int_equal(system(command), 0);
    return text;
}

static void a_model_keeps_its_picture(void **state)
{
    (void)state;
    int status;
    char *text = light("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &status);
    if (status != 0)
        fail_msg("expected 0, found %d: %s", status, text);
    free(text);
}

static void a_model_without_size_is_refused(void **state)
{
    (void)state;
    static const char *const rows[] = {"v 1 2 3\nv 1 2 3\nv 1 2 3\nf 1 2 3\n",
                                       "v 0 0 0\nv 1e-42 0 0\nv 0 1e-42 0\nf 1 2 3\n",
                                       "v 0 0 0\nv 1e30 0 0\nv 0 1e30 0\nf 1 2 3\n"};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int status;
        char *text = light("point.obj", rows[i], &status);
        if (status != 2 || !strstr(text, "point.obj: it is ") || !strstr(text, " in size, from "))
            fail_msg("expected 2 and the size, found %d: %s", status, text);
        free(text);
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_is_called_for), cmocka_unit_test(the_table_is_for_people),
                                       cmocka_unit_test(wrong_usage_is_refused), cmocka_unit_test(a_model_keeps_its_picture),
                                       cmocka_unit_test(a_model_without_size_is_refused)};
    if (argc < 2)
        return 2;
    program = argv[1];
    return cmocka_run_group_tests(tests, NULL, NULL);
}
