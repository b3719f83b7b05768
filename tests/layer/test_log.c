/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON Lines log, and the closing statement: every line parses, counts are right, and what was not judged is said. */
#include "tests/layer/harness.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <yyjson.h>

#define ENV "VK_GNOMON_RAY_TRACING_"
#define BLAS VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR

static char path[64];

/* The lines of a log, parsed; a line that does not parse fails the test. */
struct lines {
    yyjson_doc *documents[16];
    uint32_t count;
};

static struct lines lines_read(const char *from)
{
    struct lines lines = {.count = 0};
    char *text = file_read(from);
    assert_non_null(text);
    assert_true(text[0] && text[strlen(text) - 1] == '\n');
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        assert_true(lines.count < 16);
        lines.documents[lines.count] = yyjson_read(line, strlen(line), 0);
        if (!lines.documents[lines.count])
            fail_msg("not JSON: %s", line);
        lines.count++;
    }
    free(text);
    return lines;
}

static void lines_free(struct lines *lines)
{
    for (uint32_t i = 0; i < lines->count; i++)
        yyjson_doc_free(lines->documents[i]);
}

static yyjson_val *line_at(const struct lines *lines, uint32_t index)
{
    return yyjson_doc_get_root(lines->documents[index]);
}

static yyjson_val *statement_of(const struct lines *lines)
{
    assert_true(lines->count > 0);
    yyjson_val *statement = yyjson_obj_get(line_at(lines, lines->count - 1), "statement");
    assert_non_null(statement);
    return statement;
}

/* The count of the entry of `list` ("checked" or "not_checked") whose text contains `what`; 0 if there is none. */
static uint64_t counted(const struct lines *lines, const char *list, const char *what)
{
    yyjson_val *entries = yyjson_obj_get(statement_of(lines), list), *entry;
    size_t i, max;
    assert_non_null(entries);
    yyjson_arr_foreach(entries, i, max, entry)
    {
        if (strstr(yyjson_get_str(yyjson_obj_get(entry, "what")), what))
            return yyjson_get_uint(yyjson_obj_get(entry, "count"));
    }
    return 0;
}

static struct world *world_create(void)
{
    struct world *world = calloc(1, sizeof *world);
    assert_non_null(world);
    setenv(ENV "LOG_FILE", path, 1);
    setenv(ENV "REPORT_STDERR", "false", 1);
    world_init(world, NULL);
    return world;
}

static void build_times(struct world *world, struct structure *tlas, int times)
{
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, tlas);
    commands_barrier(commands);
    commands_end(commands);
    for (int i = 0; i < times; i++)
        submit_and_wait(world, commands);
}

static void findings_are_counted_in_place(void **state)
{
    (void)state;
    struct world *world = world_create();
    struct structure first = blas_create(world, BLAS, 0), second = blas_create(world, BLAS, 0);
    struct structure tlas = tlas_create(world, 4);
    structure_name(world, &first, "a \"tree\"\\ \xFF\xC3\xA9\n");
    for (uint32_t i = 0; i < 3; i++)
        tlas_refer(&tlas, i, first.address);
    build_times(world, &tlas, 3);
    tlas_refer(&tlas, 3, second.address);
    build_times(world, &tlas, 1);
    uint64_t tlas_handle = (uint64_t)tlas.handle;
    structure_destroy(world, &tlas);
    structure_destroy(world, &first);
    structure_destroy(world, &second);
    world_finish(world);
    assert_int_equal(messages_count(world, NEVER_BUILT), 2);
    free(world);

    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 3);
    yyjson_val *line = line_at(&lines, 0);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(line, "rule")), NEVER_BUILT);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(line, "severity")), "error");
    assert_int_equal(yyjson_get_uint(yyjson_obj_get(line, "count")), 12);
    assert_non_null(strstr(yyjson_get_str(yyjson_obj_get(line, "message")), "instance 0 of 4"));
    assert_non_null(yyjson_get_str(yyjson_obj_get(line, "remedy")));
    yyjson_val *objects = yyjson_obj_get(line, "objects");
    assert_int_equal(yyjson_arr_size(objects), 2);
    char handle[32];
    snprintf(handle, sizeof handle, "0x%llx", (unsigned long long)tlas_handle);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(yyjson_arr_get(objects, 0), "handle")), handle);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(yyjson_arr_get(objects, 0), "type")), "TLAS");
    assert_true(yyjson_is_null(yyjson_obj_get(yyjson_arr_get(objects, 0), "name")));
    assert_string_equal(yyjson_get_str(yyjson_obj_get(yyjson_arr_get(objects, 1), "name")),
                        "a \"tree\"\\ \xEF\xBF\xBD\xC3\xA9\n");
    assert_string_equal(yyjson_get_str(yyjson_arr_get_first(yyjson_obj_get(line, "source"))),
                        "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-06707");
    assert_int_equal(yyjson_get_uint(yyjson_obj_get(line_at(&lines, 1), "count")), 1);

    yyjson_val *statement = statement_of(&lines);
    assert_int_equal(yyjson_get_uint(yyjson_obj_get(statement, "findings")), 13);
    assert_int_equal(yyjson_get_uint(yyjson_obj_get(statement, "sites")), 2);
    assert_int_equal(counted(&lines, "checked", "TLAS builds judged"), 4);
    assert_int_equal(counted(&lines, "checked", "instances judged"), 16);
    assert_int_equal(yyjson_arr_size(yyjson_obj_get(statement, "not_checked")), 0);
    lines_free(&lines);
}

static void build_from_pointers(struct world *world, struct structure *tlas, const struct buffer *pointers)
{
    VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .arrayOfPointers = VK_TRUE,
                               .data.deviceAddress = pointers->address}};
    VkAccelerationStructureBuildGeometryInfoKHR build = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        .flags = tlas->flags,
        .dstAccelerationStructure = tlas->handle,
        .geometryCount = 1,
        .pGeometries = &geometry,
        .scratchData.deviceAddress = tlas->scratch.address};
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = 1};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    VkCommandBuffer commands = commands_begin(world, 0);
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &build, &ranges);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void what_is_not_judged_is_said(void **state)
{
    (void)state;
    struct world *world = world_create();
    struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 1);
    struct buffer pointers = buffer_create(world, 8, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    tlas_refer(&tlas, 0, blas.address);
    memcpy(pointers.mapped, &tlas.input.address, 8);
    build_from_pointers(world, &tlas, &pointers);
    build_from_pointers(world, &tlas, &pointers);

    structure_destroy(world, &tlas);
    structure_destroy(world, &blas);
    buffer_destroy(world, &pointers);
    world_finish(world);
    assert_int_equal(messages_count(world, NEVER_BUILT), 0);
    free(world);

    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 1);
    assert_int_equal(counted(&lines, "not_checked", "array of pointers"), 2);
    assert_int_equal(counted(&lines, "checked", "instances judged"), 0);
    lines_free(&lines);
}

/* The first execution is over before the second is submitted, or it was overwritten: all are accounted for. */
static void repeated_executions_add_up(void **state)
{
    (void)state;
    struct world *world = world_create();
    struct structure tlas = tlas_create(world, 1);
    VkCommandBuffer commands = commands_begin(world, VK_COMMAND_BUFFER_USAGE_SIMULTANEOUS_USE_BIT);
    commands_build_one(world, commands, &tlas);
    commands_barrier(commands);
    commands_end(commands);
    for (int i = 0; i < 20; i++)
        submit(world, commands, VK_NULL_HANDLE);
    assert_int_equal(vkQueueWaitIdle(world->queue), VK_SUCCESS);
    structure_destroy(world, &tlas);
    world_finish(world);
    free(world);
    struct lines lines = lines_read(path);
    uint64_t judged = counted(&lines, "checked", "TLAS builds judged");
    assert_true(judged >= 1);
    assert_int_equal(judged + counted(&lines, "not_checked", "repeated before they were judged"), 20);
    lines_free(&lines);
}

/* A second instance of the same process adds to the log; a new process starts it anew. */
static void instances_share_the_log(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct world *world = world_create();
        struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 1);
        tlas_refer(&tlas, 0, blas.address);
        build_times(world, &tlas, 1);
        structure_destroy(world, &tlas);
        structure_destroy(world, &blas);
        world_finish(world);
        free(world);
    }
    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 4);
    assert_non_null(yyjson_obj_get(line_at(&lines, 1), "statement"));
    assert_string_equal(yyjson_get_str(yyjson_obj_get(line_at(&lines, 2), "rule")), NEVER_BUILT);
    assert_non_null(yyjson_obj_get(line_at(&lines, 3), "statement"));
    lines_free(&lines);
}

/* Runs `body` in a child process that ends by exit() right after it. */
static void in_child(void (*body)(struct world *world))
{
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        struct world *world = world_create();
        body(world);
        exit(0);
    }
    int status = 0;
    assert_true(waitpid(child, &status, 0) == child);
    assert_true(WIFEXITED(status));
}

static void leave_a_finding(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 1);
    tlas_refer(&tlas, 0, blas.address);
    build_times(world, &tlas, 5);
}

static void a_process_that_destroys_nothing_still_gets_its_statement(void **state)
{
    (void)state;
    in_child(leave_a_finding);
    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 2);
    assert_int_equal(yyjson_get_uint(yyjson_obj_get(line_at(&lines, 0), "count")), 5);
    assert_non_null(strstr(yyjson_get_str(yyjson_obj_get(statement_of(&lines), "ending")), "without destroying"));
    lines_free(&lines);
}

static void leave_unfinished(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 1);
    tlas_refer(&tlas, 0, blas.address);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &tlas);
    commands_end(commands);
    submit(world, commands, VK_NULL_HANDLE);
}

static void work_never_seen_to_complete_is_said(void **state)
{
    (void)state;
    in_child(leave_unfinished);
    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 1);
    assert_int_equal(counted(&lines, "not_checked", "not known to have completed"), 1);
    lines_free(&lines);
}

static void leave_pending_work(struct world *world)
{
    struct structure tlas = tlas_create(world, 1);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &tlas);
    commands_end(commands);
    submit(world, commands, VK_NULL_HANDLE);
    vkDeviceWaitIdle(world->device);
    leave_a_finding(world);
}

static void a_log_is_started_anew_by_each_process(void **state)
{
    (void)state;
    in_child(leave_pending_work);
    in_child(leave_a_finding);
    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 2);
    lines_free(&lines);
}

static int new_path(void **state)
{
    (void)state;
    strcpy(path, "/tmp/gnomon-log-XXXXXX");
    int file = mkstemp(path);
    return file < 0 || close(file) != 0;
}

static int remove_path(void **state)
{
    (void)state;
    return unlink(path);
}

static void the_process_id_in_the_path(void **state)
{
    (void)state;
    char expected[64];
    snprintf(expected, sizeof expected, "/tmp/gnomon-pid-%ld.jsonl", (long)getpid());
    strcpy(path, "/tmp/gnomon-pid-%p.jsonl");
    struct world *world = world_create();
    world_finish(world);
    free(world);
    strcpy(path, expected);
    struct lines lines = lines_read(expected);
    assert_int_equal(lines.count, 1);
    lines_free(&lines);
}

/* What the schema of SARIF 2.1.0 requires of every object that the layer writes. */
static void expect_sarif(const char *text, uint32_t results, uint32_t invocations)
{
    yyjson_doc *document = yyjson_read(text, strlen(text), 0);
    if (!document)
        fail_msg("not JSON: %s", text);
    yyjson_val *root = yyjson_doc_get_root(document), *runs = yyjson_obj_get(root, "runs"), *run = yyjson_arr_get_first(runs);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(root, "version")), "2.1.0");
    assert_int_equal(yyjson_arr_size(runs), 1);
    yyjson_val *driver = yyjson_obj_get(yyjson_obj_get(run, "tool"), "driver");
    assert_string_equal(yyjson_get_str(yyjson_obj_get(driver, "name")), "Gnomon");
    yyjson_val *rules = yyjson_obj_get(driver, "rules"), *list = yyjson_obj_get(run, "results"), *item;
    size_t i, max;
    assert_true(yyjson_arr_size(rules) > 0);
    yyjson_arr_foreach(rules, i, max, item)
    {
        static const char *const texts[] = {"shortDescription", "fullDescription", "help"};
        const char *level = yyjson_get_str(yyjson_obj_get(yyjson_obj_get(item, "defaultConfiguration"), "level"));
        assert_non_null(yyjson_get_str(yyjson_obj_get(item, "id")));
        assert_true(level && strstr("none note warning error", level));
        for (int k = 0; k < 3; k++)
            assert_non_null(yyjson_get_str(yyjson_obj_get(yyjson_obj_get(item, texts[k]), "text")));
    }
    assert_int_equal(yyjson_arr_size(list), results);
    yyjson_arr_foreach(list, i, max, item)
    {
        const char *level = yyjson_get_str(yyjson_obj_get(item, "level"));
        yyjson_val *rule = yyjson_arr_get(rules, (size_t)yyjson_get_uint(yyjson_obj_get(item, "ruleIndex")));
        assert_string_equal(yyjson_get_str(yyjson_obj_get(item, "ruleId")), yyjson_get_str(yyjson_obj_get(rule, "id")));
        assert_true(level && strstr("none note warning error", level));
        assert_non_null(yyjson_get_str(yyjson_obj_get(yyjson_obj_get(item, "message"), "text")));
        assert_true(yyjson_get_uint(yyjson_obj_get(item, "occurrenceCount")) >= 1);
        yyjson_val *location = yyjson_arr_get_first(yyjson_obj_get(item, "locations"));
        assert_non_null(yyjson_get_str(
            yyjson_obj_get(yyjson_arr_get_first(yyjson_obj_get(location, "logicalLocations")), "name")));
    }
    list = yyjson_obj_get(run, "invocations");
    assert_int_equal(list ? yyjson_arr_size(list) : 0, invocations);
    yyjson_arr_foreach(list, i, max, item)
    {
        assert_true(yyjson_get_bool(yyjson_obj_get(item, "executionSuccessful")));
        assert_non_null(yyjson_obj_get(yyjson_obj_get(item, "properties"), "statement"));
    }
    yyjson_doc_free(document);
}

static void sarif_is_whole_at_every_time(void **state)
{
    (void)state;
    char sarif[80];
    snprintf(sarif, sizeof sarif, "%s.sarif", path);
    setenv(ENV "SARIF_FILE", sarif, 1);
    for (uint32_t pass = 0; pass < 2; pass++) {
        struct world *world = world_create();
        struct structure blases[] = {blas_create(world, BLAS, 0), blas_create(world, BLAS, 0)};
        structure_name(world, &blases[0], "a \"tree\"\\ \xFF");
        for (uint32_t i = 0; i < 2; i++) {
            struct structure tlas = tlas_create(world, 1);
            char *text = file_read(sarif);
            expect_sarif(text, 2 * pass + i, pass);
            free(text);
            tlas_refer(&tlas, 0, blases[i].address);
            build_times(world, &tlas, 5);
            structure_destroy(world, &tlas);
        }
        structure_destroy(world, &blases[0]);
        structure_destroy(world, &blases[1]);
        world_finish(world);
        free(world);
        char *text = file_read(sarif);
        expect_sarif(text, 2 * pass + 2, pass + 1);
        assert_non_null(strstr(text, "\"occurrenceCount\":5 "));
        free(text);
    }
    unsetenv(ENV "SARIF_FILE");
    unlink(sarif);
}

/* Findings beyond the cap reach the log, though nobody else. */
static void the_cap_bounds_what_is_told(void **state)
{
    (void)state;
    setenv(ENV "REPORT_CAP", "2", 1);
    struct world *world = world_create();
    struct structure tlas = tlas_create(world, 1), blases[4];
    for (uint32_t i = 0; i < 4; i++) {
        blases[i] = blas_create(world, BLAS, 0);
        tlas_refer(&tlas, 0, blases[i].address);
        build_times(world, &tlas, 1);
    }
    for (uint32_t i = 0; i < 4; i++)
        structure_destroy(world, &blases[i]);
    structure_destroy(world, &tlas);
    world_finish(world);
    unsetenv(ENV "REPORT_CAP");
    assert_int_equal(messages_count(world, NEVER_BUILT), 2);
    free(world);
    struct lines lines = lines_read(path);
    assert_int_equal(lines.count, 5);
    lines_free(&lines);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_process_that_destroys_nothing_still_gets_its_statement, new_path, remove_path),
        cmocka_unit_test_setup_teardown(work_never_seen_to_complete_is_said, new_path, remove_path),
        cmocka_unit_test_setup_teardown(a_log_is_started_anew_by_each_process, new_path, remove_path),
        cmocka_unit_test_setup_teardown(findings_are_counted_in_place, new_path, remove_path),
        cmocka_unit_test_setup_teardown(what_is_not_judged_is_said, new_path, remove_path),
        cmocka_unit_test_setup_teardown(repeated_executions_add_up, new_path, remove_path),
        cmocka_unit_test_setup_teardown(instances_share_the_log, new_path, remove_path),
        cmocka_unit_test_setup_teardown(sarif_is_whole_at_every_time, new_path, remove_path),
        cmocka_unit_test_setup_teardown(the_cap_bounds_what_is_told, new_path, remove_path),
        cmocka_unit_test_teardown(the_process_id_in_the_path, remove_path),
    };
    return cmocka_run_group_tests_name("log", tests, NULL, NULL);
}
