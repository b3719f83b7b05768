/* SPDX-License-Identifier: Apache-2.0 */
/* Shaders under the layer: in every stage and by every way that one takes to the driver, a mistake is told where it happened, a correct
 * run tells nothing, and what is computed stays the same. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <yyjson.h>

#include "tests/layer/ask.h"
#include "tests/layer/trace.h"

#define AFTER_FALSE "query.proceed.after_false"
#define CANDIDATES 64
#define OPACITY_PAIR "query.initialize.opacity_pair"

/* A TLAS of some triangles in one place, built. */
struct scene {
    struct structure blas, tlas;
};

static struct scene scene_create(struct world *world, uint32_t count)
{
    struct scene scene = {.blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0),
                          .tlas = tlas_create(world, count)};
    for (uint32_t i = 0; i < count; i++)
        tlas_refer(&scene.tlas, i, scene.blas.address);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
    return scene;
}

static void scene_destroy(struct world *world, struct scene *scene)
{
    structure_destroy(world, &scene->tlas);
    structure_destroy(world, &scene->blas);
}

struct row {
    const char *name;
    enum ask_stage stage;
    enum ask_way way;
    uint32_t wrong;
    unsigned count;     /* of the mistake; 0: none is told */
    const char *first;  /* the invocation of the first record; NULL: any */
    const char *why;
};

static const struct row rows[] = {
    {"compute, module", ASK_COMPUTE, ASK_BY_MODULE, 1, 1, "invocation (5, 0, 0)", "one lane of eight"},
    {"compute, module", ASK_COMPUTE, ASK_BY_MODULE, 0, 0, NULL, "no lane"},
    {"compute, inline", ASK_COMPUTE, ASK_INLINE, 1, 1, "invocation (5, 0, 0)", "maintenance5"},
    {"compute, shader object", ASK_COMPUTE, ASK_BY_OBJECT, 1, 1, "invocation (5, 0, 0)", "VK_EXT_shader_object"},
    {"compute, shader object", ASK_COMPUTE, ASK_BY_OBJECT, 0, 0, NULL, "no lane"},
    {"vertex, module", ASK_VERTEX, ASK_BY_MODULE, 1, 3, NULL, "three vertices"},
    {"vertex, module", ASK_VERTEX, ASK_BY_MODULE, 0, 0, NULL, "no vertex"},
    {"vertex, inline", ASK_VERTEX, ASK_INLINE, 1, 3, NULL, "three vertices"},
    {"fragment, module", ASK_FRAGMENT, ASK_BY_MODULE, 1, ASK_SIZE *ASK_SIZE, NULL, "every fragment"},
    {"fragment, helpers", ASK_FRAGMENT, ASK_BY_MODULE, 2, ASK_SIZE *ASK_SIZE / 4, NULL, "one of each quad is left"},
    {"fragment, module", ASK_FRAGMENT, ASK_BY_MODULE, 0, 0, NULL, "no fragment"},
    {"fragment, library", ASK_FRAGMENT, ASK_BY_LIBRARY, 1, ASK_SIZE *ASK_SIZE, NULL, "every fragment"},
    {"ray generation, module", ASK_RAYGEN, ASK_BY_MODULE, 1, 1, "invocation (3, 0, 0)", "one launch of eight"},
    {"ray generation, inline", ASK_RAYGEN, ASK_INLINE, 1, 1, "invocation (3, 0, 0)", "one launch of eight"},
    {"ray generation, module", ASK_RAYGEN, ASK_BY_MODULE, 0, 0, NULL, "no launch"},
};

/* The statement and, through out_count, how often a rule was found, from the log. */
static yyjson_doc *log_read(const char *path, const char *rule, uint64_t *out_count)
{
    char *text = file_read(path);
    yyjson_doc *statement = NULL;
    assert_non_null(text);
    *out_count = 0;
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        yyjson_doc *doc = yyjson_read(line, strlen(line), 0);
        assert_non_null(doc);
        yyjson_val *root = yyjson_doc_get_root(doc);
        if (yyjson_equals_str(yyjson_obj_get(root, "rule"), rule) && yyjson_equals_str(yyjson_obj_get(root, "severity"), "error"))
            *out_count += yyjson_get_uint(yyjson_obj_get(root, "count"));
        if (yyjson_obj_get(root, "statement")) {
            yyjson_doc_free(statement);
            statement = doc;
        } else {
            yyjson_doc_free(doc);
        }
    }
    free(text);
    assert_non_null(statement);
    return statement;
}

static bool run_row(const struct row *row, size_t index)
{
    struct world world, bare;
    char path[128];
    bool good = true;
    snprintf(path, sizeof path, "/tmp/gnomon-shaders-%ld-%zu.jsonl", (long)getpid(), index);
    const char *paths[] = {path};
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths};
    ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
    struct scene scene = scene_create(&world, 1);
    struct asker asker = asker_create(&world, row->stage, row->way, scene.tlas.handle, 1);
    asker_name(&world, &asker, "the module", "the pipeline");
    for (int times = 0; times < 2; times++)
        asker_run(&world, &asker, row->wrong);

    const struct message *message = messages_find(&world, AFTER_FALSE);
    uint32_t others = 0;
    for (uint32_t i = 0; i < world.messages.count && i < 64; i++)
        others += strchr(world.messages.list[i].id, '.') && strcmp(world.messages.list[i].id, AFTER_FALSE) != 0;
    bool located = message && strstr(message->text, "asks.glsl:13") && strstr(message->text, "rayQueryProceedEXT(q);") &&
                   strstr(message->text, "the pipeline") && (!row->first || strstr(message->text, row->first)) &&
                   (row->way != ASK_BY_MODULE || strstr(message->text, "the module"));
    if (others || (row->count ? !located || messages_count(&world, AFTER_FALSE) != 1 : message != NULL)) {
        print_error("%s (%s): %s%s\n", row->name, row->why, others ? "another finding; " : "", message ? message->text : "no finding");
        good = false;
    }

    /* The same without the layer. A mistake may do anything, so only what is right is compared. */
    ask_world_init(&bare, &(struct world_options){.without_layer = true});
    struct scene bare_scene = scene_create(&bare, 1);
    struct asker bare_asker = asker_create(&bare, row->stage, row->way, bare_scene.tlas.handle, 1);
    asker_run(&bare, &bare_asker, 0);
    asker_run(&world, &asker, 0);
    if (memcmp(asker.out.mapped, bare_asker.out.mapped, asker.out.size) != 0) {
        print_error("%s (%s): another result under the layer\n", row->name, row->why);
        good = false;
    }
    asker_destroy(&bare, &bare_asker);
    scene_destroy(&bare, &bare_scene);
    world_finish(&bare);
    asker_destroy(&world, &asker);
    scene_destroy(&world, &scene);
    world_finish(&world);

    uint64_t count;
    yyjson_doc *doc = log_read(path, AFTER_FALSE, &count);
    yyjson_val *shaders = yyjson_obj_get(yyjson_obj_get(yyjson_doc_get_root(doc), "statement"), "shaders");
    yyjson_val *stated = yyjson_arr_get_first(shaders);
    if (count != 2 * row->count || !yyjson_equals_str(yyjson_obj_get(stated, "status"), "instrumented") ||
        !yyjson_equals_str(yyjson_obj_get(stated, "name"), "the pipeline") || !yyjson_get_uint(yyjson_obj_get(stated, "checked")) ||
        !yyjson_get_uint(yyjson_obj_get(stated, "proved"))) {
        char *text = yyjson_val_write(shaders, 0, NULL);
        print_error("%s (%s): expected %u mistakes, found %llu; stated %s\n", row->name, row->why, 2 * row->count,
                    (unsigned long long)count, text);
        free(text);
        good = false;
    }
    yyjson_doc_free(doc);
    unlink(path);
    return good;
}

static void every_way(void **state)
{
    int failures = 0;
    (void)state;
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++)
        failures += !run_row(&rows[r], r);
    assert_int_equal(failures, 0);
}

/* The flags are a specialization constant, so only the driver knows them. */
static void specialized_operands(void **state)
{
    static const struct {
        uint32_t flags, expected;
    } table[] = {{0, 0}, {1, 0}, {1 | 2, 1}};
    static const enum ask_way ways[] = {ASK_BY_MODULE, ASK_INLINE, ASK_BY_OBJECT};
    const size_t count = sizeof table / sizeof table[0], all = count * (sizeof ways / sizeof ways[0]);
    (void)state;
    for (size_t run = 0; run < all; run++) {
        const size_t i = run % count;
        struct world world;
        ask_world_init(&world, NULL);
        world.above_khronos = false; /* what it says of flags that exclude each other is not the point */
        struct scene scene = scene_create(&world, 1);
        struct asker asker = asker_create(&world, ASK_COMPUTE, ways[run / count], scene.tlas.handle, table[i].flags);
        asker_run(&world, &asker, 0);
        assert_int_equal(messages_count(&world, OPACITY_PAIR), table[i].expected);
        asker_destroy(&world, &asker);
        scene_destroy(&world, &scene);
        world_finish(&world);
    }
}

/* What a setting leaves of the shader. */
static void levels(void **state)
{
    static const struct {
        const char *level, *status;
        uint32_t told;
    } table[] = {{"off", NULL, 0}, {"static", "untouched", 0}, {"on", "instrumented", 1}, {"unproved", "instrumented", 1}};
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        char path[128];
        uint64_t count;
        snprintf(path, sizeof path, "/tmp/gnomon-levels-%ld-%zu.jsonl", (long)getpid(), i);
        const char *paths[] = {path};
        VkLayerSettingEXT settings[] = {
            {"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths},
            {"VK_LAYER_GNOMON_ray_tracing", "shader_checks", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, &table[i].level}};
        ask_world_init(&world, &(struct world_options){.settings = settings, .setting_count = 2});
        struct scene scene = scene_create(&world, 1);
        struct asker asker = asker_create(&world, ASK_COMPUTE, ASK_BY_MODULE, scene.tlas.handle, 1);
        asker_run(&world, &asker, 1);
        assert_int_equal(messages_count(&world, AFTER_FALSE), table[i].told);
        asker_destroy(&world, &asker);
        scene_destroy(&world, &scene);
        world_finish(&world);
        yyjson_doc *doc = log_read(path, AFTER_FALSE, &count);
        yyjson_val *shaders = yyjson_obj_get(yyjson_obj_get(yyjson_doc_get_root(doc), "statement"), "shaders");
        assert_int_equal(yyjson_arr_size(shaders), table[i].status ? 1 : 0);
        if (table[i].status)
            assert_string_equal(yyjson_get_str(yyjson_obj_get(yyjson_arr_get_first(shaders), "status")), table[i].status);
        yyjson_doc_free(doc);
        unlink(path);
    }
}

/* What safe mode makes of misuse is defined, and told all the same. */
static void safe_mode(void **state)
{
    static const struct {
        enum ask_stage stage;
        uint32_t wrong;
        float expected; /* in every lane */
        const char *told;
        const char *why;
    } table[] = {
        {ASK_COMPUTE, 1, 1, AFTER_FALSE, "the Proceed too many is skipped"},
        {ASK_RAYGEN, 1, 1, AFTER_FALSE, "also there"},
        {ASK_LONG, 0, CANDIDATES, NULL, "all candidates"},
        {ASK_LONG, 1, CANDIDATES + 0.5f, "query.initialize.negative_t", "a ray that hits nothing; what is not there is 0"},
        {ASK_LONG, 2, CANDIDATES + 0.5f, "query.use.uninitialized", "all of an unknown query is 0, and so is its type: none"},
        {ASK_LONG, 2, CANDIDATES + 0.5f, "query.candidate.none", "no candidate"},
        {ASK_LONG, 2, CANDIDATES + 0.5f, "query.committed.none", "nothing is committed"},
        {ASK_LONG, 2, CANDIDATES + 0.5f, "query.confirm.no_candidate", "nothing to confirm"},
        {ASK_LONG, 2, CANDIDATES + 0.5f, "query.terminate.after_false", "it is over"},
    };
    (void)state;
    VkBool32 yes = VK_TRUE;
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &yes};
    int failures = 0;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
        world.above_khronos = false;
        struct scene scene = scene_create(&world, CANDIDATES);
        struct asker asker = asker_create(&world, table[i].stage, ASK_BY_MODULE, scene.tlas.handle, 1);
        asker_run(&world, &asker, table[i].wrong);
        const float *out = asker.out.mapped;
        for (uint32_t lane = 0; lane < ASK_LANES; lane++)
            if (out[lane] != table[i].expected) {
                print_error("row %zu (%s), lane %u: expected %g, found %g\n", i, table[i].why, lane, (double)table[i].expected,
                            (double)out[lane]);
                failures++;
                break;
            }
        if (table[i].told && !messages_count(&world, table[i].told)) {
            print_error("row %zu (%s): %s is not told\n", i, table[i].why, table[i].told);
            failures++;
        }
        asker_destroy(&world, &asker);
        scene_destroy(&world, &scene);
        world_finish(&world);
    }
    assert_int_equal(failures, 0);
}

static uint64_t statement_count(const char *path, const char *what)
{
    uint64_t ignored, count = 0;
    yyjson_doc *doc = log_read(path, AFTER_FALSE, &ignored);
    yyjson_val *checked = yyjson_obj_get(yyjson_obj_get(yyjson_doc_get_root(doc), "statement"), "checked"), *entry;
    size_t index, max;
    yyjson_arr_foreach(checked, index, max, entry)
    {
        if (yyjson_equals_str(yyjson_obj_get(entry, "what"), what))
            count = yyjson_get_uint(yyjson_obj_get(entry, "count"));
    }
    yyjson_doc_free(doc);
    return count;
}

/* Spoils the only file of a folder, or removes it with the folder. */
static void spoil(const char *folder, bool remove)
{
    char command[256];
    snprintf(command, sizeof command, remove ? "rm -rf '%s'" : "printf x | dd of=\"$(ls -d '%s'/*)\" bs=1 seek=99 conv=notrunc 2>/dev/null",
             folder);
    assert_int_equal(system(command), 0);
}

/* The second run reads what the first has written, and tells the same; a spoiled file is made anew. */
static void cache(void **state)
{
    static const uint64_t expected[] = {0, 1, 0, 1};
    char folder[64] = "/tmp/gnomon-cache-XXXXXX", path[128];
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s.jsonl", folder);
    const char *folders[] = {folder}, *paths[] = {path};
    VkLayerSettingEXT settings[] = {{"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths},
                                    {"VK_LAYER_GNOMON_ray_tracing", "shader_cache", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, folders}};
    for (size_t run = 0; run < sizeof expected / sizeof expected[0]; run++) {
        struct world world;
        if (run == 2)
            spoil(folder, false);
        ask_world_init(&world, &(struct world_options){.settings = settings, .setting_count = 2});
        struct scene scene = scene_create(&world, 1);
        struct asker asker = asker_create(&world, ASK_COMPUTE, ASK_BY_MODULE, scene.tlas.handle, 1);
        asker_run(&world, &asker, 1);
        const struct message *message = messages_find(&world, AFTER_FALSE);
        assert_true(message && strstr(message->text, "asks.glsl:13") && strstr(message->text, "invocation (5, 0, 0)"));
        asker_destroy(&world, &asker);
        scene_destroy(&world, &scene);
        world_finish(&world);
        assert_int_equal(statement_count(path, "of them read from shader_cache"), expected[run]);
        unlink(path);
    }
    spoil(folder, true);
}

/* A process that ends right after it was submitted, or waits for nothing, has its records read all the same. */
static void left_behind(void **state)
{
    char path[128];
    uint64_t count;
    (void)state;
    snprintf(path, sizeof path, "/tmp/gnomon-left-%ld.jsonl", (long)getpid());
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const char *paths[] = {path};
        VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths};
        static struct world world;
        ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
        struct scene scene = scene_create(&world, 1);
        struct asker asker = asker_create(&world, ASK_COMPUTE, ASK_BY_MODULE, scene.tlas.handle, 1);
        asker_run(&world, &asker, 1);
        asker_run(&world, &asker, 1);
        exit(0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    yyjson_doc *doc = log_read(path, AFTER_FALSE, &count);
    yyjson_val *shaders = yyjson_obj_get(yyjson_obj_get(yyjson_doc_get_root(doc), "statement"), "shaders");
    assert_int_equal(count, 2);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(yyjson_arr_get_first(shaders), "status")), "instrumented");
    yyjson_doc_free(doc);
    unlink(path);
}

/* Traces, and is killed before anybody could read what came of it. The setting is in `folder`, or in the environment. */
static void be_killed(const char *folder, uint32_t wrong)
{
    static struct world world;
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "records_folder", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, &folder};
    ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = folder ? 1 : 0});
    struct scene scene = scene_create(&world, 1);
    struct asker asker = asker_create(&world, ASK_COMPUTE, ASK_BY_MODULE, scene.tlas.handle, 1);
    VkCommandBuffer commands = asker_record(&world, &asker, wrong);
    submit(&world, commands, VK_NULL_HANDLE);
    const volatile float *out = asker.out.mapped;
    /* A lane that does wrong may leave anything. */
    while (out[0] == 0 || out[ASK_LANES - 1] == 0)
        usleep(1000);
    usleep(100000);
    kill(getpid(), SIGKILL);
}

/* A byte of a file in the only folder of `folder`. */
static void damage(const char *folder, const char *file)
{
    char command[256];
    snprintf(command, sizeof command, "printf x | dd of=\"$(ls -d '%s'/*/%s)\" bs=1 seek=12 conv=notrunc 2>/dev/null", folder, file);
    assert_int_equal(system(command), 0);
}

/* A process that was killed leaves its records to the next that has the folder; damage there is no harm. */
static void killed(void **state)
{
    static const struct {
        uint32_t wrong;
        const char *damaged; /* NULL: nothing */
        uint32_t told;
    } table[] = {{1, NULL, 1}, {0, NULL, 0}, {1, "index", 0}, {1, "gnomon-shader-*", 0}};
    char folder[64] = "/tmp/gnomon-killed-XXXXXX", path[128], remark[64];
    const char *folders[] = {folder}, *paths[] = {path};
    VkLayerSettingEXT settings[] = {{"VK_LAYER_GNOMON_ray_tracing", "records_folder", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, folders},
                                    {"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths}};
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s.jsonl", folder);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        int status;
        pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            alarm(60);
            be_killed(folder, table[i].wrong);
        }
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
        if (table[i].damaged)
            damage(folder, table[i].damaged);
        struct world world;
        world_init(&world, &(struct world_options){.settings = settings, .setting_count = 2});
        world_finish(&world);
        char *log = file_read(path);
        uint64_t told;
        snprintf(remark, sizeof remark, "Left by process %ld,", (long)child);
        yyjson_doc_free(log_read(path, AFTER_FALSE, &told));
        assert_int_equal(told, table[i].told);
        assert_true(!told || (strstr(log, "asks.glsl:13") && strstr(log, "invocation (5, 0, 0)") && strstr(log, remark)));
        free(log);
        unlink(path);
        /* Nothing is left there, whatever it was. */
        assert_int_equal(rmdir(folder), 0);
        assert_int_equal(mkdir(folder, 0700), 0);
    }
    assert_int_equal(rmdir(folder), 0);
}

static void proceed_limit(void **state)
{
    static const struct {
        int32_t limit;
        VkBool32 safe;
        uint32_t told;
        float expected;
    } table[] = {{0, VK_FALSE, 0, CANDIDATES},
                 {CANDIDATES + 1, VK_FALSE, 0, CANDIDATES}, /* one more says that there are no more */
                 {CANDIDATES, VK_FALSE, 1, CANDIDATES},
                 {10, VK_FALSE, 1, CANDIDATES},
                 {10, VK_TRUE, 1, 10}};
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        VkLayerSettingEXT settings[] = {
            {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &table[i].safe},
            {"VK_LAYER_GNOMON_ray_tracing", "proceed_limit", VK_LAYER_SETTING_TYPE_INT32_EXT, 1, &table[i].limit}};
        ask_world_init(&world, &(struct world_options){.settings = settings, .setting_count = 2});
        struct scene scene = scene_create(&world, CANDIDATES);
        struct asker asker = asker_create(&world, ASK_LONG, ASK_BY_MODULE, scene.tlas.handle, 1);
        asker_run(&world, &asker, 0);
        assert_int_equal(messages_count(&world, "query.proceed.limit"), table[i].told);
        for (uint32_t lane = 0; lane < ASK_LANES; lane++)
            assert_true(((const float *)asker.out.mapped)[lane] == table[i].expected);
        asker_destroy(&world, &asker);
        scene_destroy(&world, &scene);
        world_finish(&world);
    }
}

/* What is behind the descriptor that a ray is traced through. In safe mode, for a driver may do anything with what is not built. */
static void structures(void **state)
{
    enum { BUILT, NEVER, BOTTOM, DESTROYED, UNWRITTEN, COUNT };
    static const struct {
        int element[ASK_SCENES]; /* of the array; UNWRITTEN elements are not written */
        uint32_t asked;
        const char *expected, *text;
    } table[] = {
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 0, NULL, NULL},
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 1, "structure.never_built", "set 0, binding 0, element 1: TLAS \"never\""},
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 2, "structure.bottom_level", "element 2: BLAS"},
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 3, "structure.none", "element 3."},
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 4, "structure.none", "element 4."}, /* beyond */
        {{BUILT, NEVER, BOTTOM, UNWRITTEN}, 100, NULL, NULL},                   /* there, but not traced through */
        {{DESTROYED, BUILT, NEVER, NEVER}, 0, "structure.destroyed", "element 0: TLAS \"gone\""},
        {{DESTROYED, BUILT, NEVER, NEVER}, 1, NULL, NULL},
    };
    (void)state;
    VkBool32 yes = VK_TRUE;
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &yes};
    int failures = 0;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
        world.above_khronos = false;
        struct scene scene = scene_create(&world, 1), gone = scene_create(&world, 1);
        struct structure never = tlas_create(&world, 1);
        structure_name(&world, &never, "never");
        structure_name(&world, &gone.tlas, "gone");
        const VkAccelerationStructureKHR handles[COUNT] = {scene.tlas.handle, never.handle, scene.blas.handle, gone.tlas.handle};
        struct asker asker = asker_create(&world, ASK_MANY, ASK_BY_MODULE, VK_NULL_HANDLE, 0);
        for (uint32_t e = 0; e < ASK_SCENES; e++)
            if (table[i].element[e] != UNWRITTEN)
                asker_refer(&world, &asker, e, handles[table[i].element[e]]);
        structure_destroy_handle(&world, &gone.tlas);
        asker_run(&world, &asker, table[i].asked);
        const struct message *message = table[i].expected ? messages_find(&world, table[i].expected) : NULL;
        uint32_t others = 0;
        for (uint32_t m = 0; m < world.messages.count && m < 64; m++)
            others += strncmp(world.messages.list[m].id, "structure.", 10) == 0 && &world.messages.list[m] != message;
        float right = table[i].expected || table[i].asked == 100 ? -1.0f : 1.0f, found = *(const float *)asker.out.mapped;
        if (others || found != right || (table[i].expected && (!message || !strstr(message->text, table[i].text)))) {
            print_error("row %zu: expected %s and %g, found %g and %s\n", i, table[i].expected ? table[i].expected : "nothing",
                        (double)right, (double)found, message ? message->text : "no such finding");
            failures++;
        }
        asker_destroy(&world, &asker);
        structure_destroy(&world, &never);
        scene_destroy(&world, &gone);
        scene_destroy(&world, &scene);
        world_finish(&world);
    }
    assert_int_equal(failures, 0);
}

/* A TLAS that nothing has built is an error where a shader certainly traces through it, else a note, until the operation has run on it. */
static void proof_of_use(void **state)
{
    static const struct {
        enum trace_shader shader;
        uint32_t traces; /* what TRACE_MAYBE is told */
        const char *use;
        VkDebugUtilsMessageSeverityFlagBitsEXT severity;
        uint32_t ran;
    } table[] = {
        {TRACE_ALWAYS, 0, "use.tlas_never_built", VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT, 1},
        {TRACE_MAYBE, 1, "use.tlas_never_built_bound", VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT, 1},
        {TRACE_MAYBE, 0, "use.tlas_never_built_bound", VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT, 0},
    };
    (void)state;
    VkBool32 yes = VK_TRUE;
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &yes};
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        ask_world_init(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
        world.above_khronos = false;
        struct structure tlas = tlas_create(&world, 1);
        struct tracer tracer = tracer_create(&world, table[i].shader, TRACE_BY_WRITE);
        tracer_refer(&world, &tracer, tlas.handle);
        ((uint32_t *)tracer.hits.mapped)[1] = table[i].traces;
        VkCommandBuffer commands = commands_begin(&world, 0);
        commands_trace(&world, commands, &tracer, VK_NULL_HANDLE, 1);
        commands_end(commands);
        submit_and_wait(&world, commands);
        const struct message *use = messages_find(&world, table[i].use), *ran = messages_find(&world, "structure.never_built");
        assert_true(use && use->severity == table[i].severity);
        assert_int_equal(messages_count(&world, "structure.never_built"), table[i].ran);
        assert_true(!ran || ran->severity == VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT);
        tracer_destroy(&world, &tracer);
        structure_destroy(&world, &tlas);
        world_finish(&world);
    }
}

/* Vertices are read of BLASes that allow it (A) and of some that do not (-). In safe mode, for a driver may do anything else. */
static void positions(void **state)
{
    static const struct {
        const char *built, *rebuilt; /* rebuilt: the BLASes alone once more, NULL: not */
        bool again;                  /* and the TLAS */
        uint32_t both;               /* lanes ask both instances, or the first alone */
        uint64_t told;               /* lanes */
        const char *text;
    } table[] = {
        {"AA", NULL, false, 1, 0, NULL},
        {"--", NULL, false, 1, 8, "TLAS"},
        {"A-", NULL, false, 1, 4, "instance 1: TLAS"},
        {"-A", NULL, false, 1, 4, "instance 0: TLAS"},
        {"A-", NULL, false, 0, 0, NULL},
        {"A-", "-A", true, 1, 4, "instance 0: TLAS"},
        {"A-", "AA", true, 1, 0, NULL},
        {"--", "AA", true, 1, 0, NULL},
        {"AA", "--", true, 1, 8, "TLAS"},
        {"A-", "AA", false, 1, 0, NULL}, /* what the TLAS leads to now is not known */
    };
    (void)state;
    VkBool32 yes = VK_TRUE;
    int failures = 0;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world world;
        char path[128];
        snprintf(path, sizeof path, "/tmp/gnomon-positions-%ld.jsonl", (long)getpid());
        const char *paths[] = {path};
        VkLayerSettingEXT settings[] = {{"VK_LAYER_GNOMON_ray_tracing", "log_file", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, paths},
                                        {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &yes}};
        ask_world_init(&world, &(struct world_options){.settings = settings, .setting_count = 2});
        world.above_khronos = false;
        struct structure blas[2], tlas = tlas_create(&world, 2), *both[] = {&blas[0], &blas[1]};
        for (uint32_t b = 0; b < 2; b++) {
            blas[b] = blas_create(&world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                  VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR);
            tlas_refer(&tlas, b, blas[b].address);
        }
        tlas_instance(&tlas, 1)->transform.matrix[0][3] = 10;
        struct asker asker = asker_create(&world, ASK_POSITIONS, ASK_BY_MODULE, tlas.handle, 0);
        for (int round = 0; round < (table[i].rebuilt ? 2 : 1); round++) {
            const char *flags = round ? table[i].rebuilt : table[i].built;
            VkCommandBuffer commands = commands_begin(&world, 0);
            for (int b = 0; b < 2; b++)
                blas[b].flags = flags[b] == 'A' ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR : 0;
            commands_build(&world, commands, both, 2);
            commands_barrier(commands);
            if (!round || table[i].again)
                commands_build_one(&world, commands, &tlas);
            commands_barrier(commands);
            commands_end(commands);
            submit_and_wait(&world, commands);
        }
        asker_run(&world, &asker, table[i].both);
        const struct message *message = messages_find(&world, "structure.no_positions");
        char *shown = message ? strdup(message->text) : NULL;
        asker_destroy(&world, &asker);
        structure_destroy(&world, &tlas);
        for (int b = 0; b < 2; b++)
            structure_destroy(&world, &blas[b]);
        world_finish(&world);
        uint64_t told;
        yyjson_doc_free(log_read(path, "structure.no_positions", &told));
        unlink(path);
        if (told != table[i].told || (table[i].text && (!shown || !strstr(shown, table[i].text)))) {
            print_error("row %zu (%s, %s): expected %llu of \"%s\", found %llu: %s\n", i, table[i].built,
                        table[i].rebuilt ? table[i].rebuilt : "not rebuilt", (unsigned long long)table[i].told,
                        table[i].text ? table[i].text : "", (unsigned long long)told, shown ? shown : "nothing");
            failures++;
        }
        free(shown);
    }
    assert_int_equal(failures, 0);
}

int main(int argc, char **argv)
{
    if (argc == 2 && strncmp(argv[1], "killed-", 7) == 0)
        be_killed(NULL, strcmp(argv[1], "killed-wrong") == 0);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_way),
        cmocka_unit_test(specialized_operands),
        cmocka_unit_test(levels),
        cmocka_unit_test(safe_mode),
        cmocka_unit_test(structures),
        cmocka_unit_test(proof_of_use),
        cmocka_unit_test(positions),
        cmocka_unit_test(cache),
        cmocka_unit_test(left_behind),
        cmocka_unit_test(killed),
        cmocka_unit_test(proceed_limit),
    };
    return cmocka_run_group_tests_name("layer.shaders", tests, NULL, NULL);
}
