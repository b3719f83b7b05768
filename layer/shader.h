/* SPDX-License-Identifier: Apache-2.0 */
/* Shaders that check themselves: what a device needs for them (shader_device.c), modules on their way to the driver (shader.c), the
 * pipelines made of them (pipeline.c), the cache on disk (cache.c), what a trace tells them (launch.c), the memory they leave records in (shader_memory.c), also when the process is killed (left.c), and what is told of both (shader_report.c). */
#ifndef GN_LAYER_SHADER_H
#define GN_LAYER_SHADER_H

#include "checks/spirv/records.h"
#include "checks/spirv/spirv.h"
#include "layer/layer.h"

/* A change of what the application asks for when it creates a device. Lives as long as the call. */
struct gn_device_wish {
    VkDeviceCreateInfo info; /* what to create the device with */
    bool addresses, vertex_stores, fragment_stores, host_memory, null_descriptors, positions; /* what the device will have */
    const char **extensions;
    VkPhysicalDeviceFeatures features;
    VkPhysicalDeviceBufferDeviceAddressFeatures address_features;
    struct gn_chain_copy chain;
};
/* shader_device.c: enables what instrumented shaders need, where the device has it and the application did not ask for it. */
void gn_device_wish_init(struct gn_device_wish *wish, struct gn_instance *instance, VkPhysicalDevice physical,
                         const VkDeviceCreateInfo *info);
void gn_device_wish_finish(struct gn_device_wish *wish);

/* A piece of memory that the device writes records to. */
struct gn_record_memory {
    VkBuffer buffer;
    VkDeviceMemory memory;
    uint32_t *words;
    uint64_t address;
    size_t word_count, used;
    void *mapping; /* the layer's own, imported; NULL: the driver's */
    bool outlives; /* a file, which the process leaves when it is killed */
    uint32_t piece; /* its number then */
    struct gn_record_memory *next;
};

/* One shader as the layer knows it, told apart by its content: the same words, wherever they come from, are one. Lives as long as the
 * device. All but `told` and `stated` is constant once it is in the map. */
struct gn_shader {
    uint64_t key;
    struct gn_spirv_result result; /* with the new words, if there are any */
    const char *passed_because;    /* why the device could not take the instrumented words; NULL: it could */
    const struct gn_shader *judged;/* the shader of the module that it was made for; NULL: of none */
    uint32_t model;                /* execution model of the first entry point */
    bool asks_launch;              /* some check needs to know what is launched (launch.c) */
    uint32_t *records;             /* its record buffer as the host sees it; NULL if there are no checks */
    size_t record_words;
    uint64_t *told;                /* per check: how often it was told; lies behind the records */
    bool stated;                   /* it is in the closing statement */
};

/* What a device has for its shaders; NULL in gn_device where shaders are left alone. Guarded by the device's lock. */
struct gn_shaders {
    struct gn_spirv_options options;
    uint64_t seed;          /* of keys: the options */
    bool vertex_stores, fragment_stores, host_memory, stable;
    bool null_descriptors, spare_buffers;
    const char *no_records; /* why nothing can be recorded on this device; NULL: it can */
    struct gn_map shaders;  /* by key */
    struct gn_map modules;  /* struct gn_module by handle: those with queries or traces */
    struct gn_map pipelines;/* struct gn_pipeline by handle: the same, and shader objects */
    struct gn_record_memory *memory; /* newest first; the last holds the table */
    VkBuffer root_buffer;   /* that the table is at the start of */
    uint32_t depths, depth_count; /* words behind the table, one per launch index */
    bool asks_launch;       /* some shader does */
    bool launched, launch_unsure; /* on launch_queue; and on another one as well, so that what a launch was told may be another's */
    uint32_t launch_queue;
    struct gn_left *left;   /* NULL: records end with the process */
    uint32_t *_Atomic root;
    atomic_uint fired;      /* of the table, when records were last read */
    atomic_bool again;      /* read once more, whatever the table says */
    struct gn_deferred *deferred; /* what a deferred operation may still read */
    struct temporary *deferred_modules;
    uint32_t *structures;   /* the table of structures (mirror.c); NULL: none */
    uint64_t structures_address;
    uint32_t next_structure;
    bool positions;         /* shaders may read those of vertices (positions.c) */
    bool positions_possible;/* some BLAS may have been built so that they can be read */
    size_t positions_used;  /* words of the lists behind the table */
    struct gn_mirror *idle_mirrors, *no_mirror;
};

struct gn_module {
    VkShaderModule handle;
    struct gn_shader *shader;
    char *name;
    uint32_t *words; /* as the application gave them */
    size_t bytes;
};

struct gn_stage {
    struct gn_shader *shader;
    VkShaderStageFlagBits stage;
    char *module_name; /* as the pipeline was created; NULL if it had none */
};

struct gn_pipeline {
    uint64_t handle;
    bool is_object; /* a shader object */
    bool asks_launch; /* some stage does */
    char *name;
    uint32_t stage_count;
    struct gn_stage stages[];
};

/* What a ray-tracing pipeline says of its shaders; zeros for any other. */
struct gn_ray_facts {
    uint32_t known;
    uint32_t recursion;         /* maxPipelineRayRecursionDepth */
    uint32_t payload, attribute;/* sizes of its interface in bytes; 0: it has none */
    uint32_t forbidden;         /* ray flags */
};

/* shader.c; without any lock. */
bool gn_shaders_init(struct gn_device *device, const struct gn_device_wish *wish);
void gn_shaders_finish(struct gn_device *device);
/* The shader of these words, looked at in one of these ways; NULL for one that the layer leaves alone. */
enum gn_shader_way {
    GN_SHADER_JUDGED,       /* not instrumented: nothing is known yet of the pipeline that it is for */
    GN_SHADER_INSTRUMENTED, /* if that is called for */
    GN_SHADER_MIRRORED,     /* the same, where the sets that it reads structures from have mirrors */
};
/* `judged`: the same words as they were judged before, so that nothing is told twice; NULL if they were not. */
struct gn_shader *gn_shader_of(struct gn_device *device, const uint32_t *words, size_t bytes, enum gn_shader_way way,
                               const struct gn_ray_facts *facts, struct gn_shader *judged);

/* cache.c: what was made of the words and options that `entry` stands for. A file that cannot be read or written is not there. */
/* Makes the folder if it is not there. False with a message if files cannot be kept in it. */
bool gn_shader_cache_usable(const char *folder, char *problem, size_t problem_size);
bool gn_shader_cache_load(const char *folder, uint64_t entry, struct gn_spirv_result *out);
void gn_shader_cache_store(const char *folder, uint64_t entry, const struct gn_spirv_result *result);

/* launch.c */
/* Records what tells shaders about the trace that is recorded next; `callable` is NULL where that is not known. Without any lock. */
void gn_launch_tell(struct gn_device *device, VkCommandBuffer commands, const VkStridedDeviceAddressRegionKHR *callable);
/* Whether what a check counts rests on what was told. */
bool gn_launch_matters(const struct gn_spirv_site *site, enum gn_spirv_rule_index rule);

/* pipeline.c; with the device locked. */
void gn_pipelines_finish(struct gn_device *device);
char **gn_pipeline_name(struct gn_device *device, VkObjectType type, uint64_t handle);

/* shader_memory.c; with the device locked. */
bool gn_record_memory_begin(struct gn_device *device);
/* The words that the records of so many checks take, with what was told of them; 0 if they are too many. */
size_t gn_record_words(uint32_t checks);
/* The shader's records are at these words. */
void gn_record_memory_lay(struct gn_shader *shader, uint32_t *words);
/* A record buffer for the shader, entered into the table. */
bool gn_record_memory_take(struct gn_device *device, struct gn_shader *shader);
/* Words for anything else, and the piece that they are in; NULL without memory. */
struct gn_record_memory *gn_record_memory_words(struct gn_device *device, size_t words, size_t alignment, uint32_t **out);
void gn_record_memory_finish(struct gn_device *device);

/* left.c: the records of one device in files. */
struct gn_left;
/* NULL without the setting, or when the folder cannot be written, which is said. */
struct gn_left *gn_left_begin(struct gn_instance *instance);
/* A file of that size to be mapped, closed by the caller; negative when there is none. */
int gn_left_piece(struct gn_left *left, size_t bytes, uint32_t *out_number);
/* The shader's records start at that word of the piece. */
void gn_left_shader(struct gn_left *left, const struct gn_shader *shader, uint32_t piece, size_t start);
/* All was told: removes the files. */
void gn_left_end(struct gn_left *left);
/* Tells what processes that are gone have left in the instance's folder. */
void gn_left_tell(struct gn_instance *instance);

/* mirror.c; with the device locked. */
void gn_mirrors_begin(struct gn_device *device);
void gn_mirrors_finish(struct gn_device *device);
/* A new structure, and any change of one: what the table says of it. */
void gn_structure_enter(struct gn_device *device, struct gn_as *as);
void gn_structure_tell(struct gn_device *device, const struct gn_as *as);
/* positions.c: words behind the table, and what it says of structures that a shader cannot tell. */
size_t gn_positions_room(const struct gn_device *device);
void gn_positions_tell_all(struct gn_device *device);
/* NULL when it is not remembered. */
const struct gn_as *gn_structure_by_id(struct gn_device *device, uint32_t id);

/* shader_report.c */
/* Whose records are read, and how. */
struct gn_records_teller {
    struct gn_instance *instance;
    struct gn_device *device; /* locked; NULL: gone */
    const char *remark;       /* of every finding, NULL: none */
    bool last;                /* there is no later time: what is still on its way is told as it is */
    bool launch_unsure;       /* what launches were told may have been of others */
};
/* False when something was counted that is still on its way. */
bool gn_shader_collect(const struct gn_records_teller *teller, struct gn_shader *shader, struct gn_findings *out);
/* Tells what the device has recorded since the last time; cheap if that is nothing. `lost`: the device was, and nothing is certain of it.
 * `last`: there is no later time. Without any lock. */
void gn_shaders_read(struct gn_device *device, bool lost, bool last);
/* The same at the end of a process that leaves its device behind: no Vulkan call, and only of memory that is the layer's own. */
void gn_shaders_read_left(struct gn_device *device);
/* What the module alone proves, beyond what was proved of the one that it was made for. */
void gn_shader_tell_static(struct gn_device *device, const struct gn_shader *shader);
/* What was checked of a pipeline goes into the closing statement; and of shaders that never were in one. With the device locked. */
void gn_shader_state(struct gn_device *device, const struct gn_pipeline *pipeline);
void gn_shaders_state_rest(struct gn_device *device);
/* The rule of the catalogue's form, for findings. */
const struct gn_rule *gn_shader_rule(enum gn_spirv_rule_index index);

#endif
