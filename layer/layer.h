/* SPDX-License-Identifier: Apache-2.0 */
/* The layer's own state. Vulkan's objects live in per-device maps behind one mutex; rules run outside of it.
 *
 * Time: every device counts positions. Creating, destroying, and each executed command that touches an acceleration structure
 * take the next position, so that positions of one queue are in submission order. Commands are recorded as
 * events without a position; replaying a submission gives them theirs (submit.c). */
#ifndef GN_LAYER_LAYER_H
#define GN_LAYER_LAYER_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

#include "checks/rules/geometry.h"
#include "checks/rules/instance.h"
#include "checks/rules/rules.h"
#include "layer/map.h"
#include "layer/settings.h"

#define GN_INSTANCE_COMMAND(name) extern __typeof__(vk##name) gn_entry_##name;
#define GN_DEVICE_COMMAND(name) extern __typeof__(vk##name) gn_entry_##name;
#define GN_DEVICE_OWN(name) extern __typeof__(vk##name) gn_entry_##name;
#include "layer/commands.def"
extern __typeof__(vkCreateInstance) gn_entry_CreateInstance;
extern __typeof__(vkDestroyDevice) gn_entry_DestroyDevice;
extern __typeof__(vkGetInstanceProcAddr) gn_entry_GetInstanceProcAddr;
extern __typeof__(vkGetDeviceProcAddr) gn_entry_GetDeviceProcAddr;

struct gn_instance_next {
    PFN_vkGetInstanceProcAddr GetInstanceProcAddr;
#define GN_INSTANCE_COMMAND(name) PFN_vk##name name;
#define GN_INSTANCE_USED(name) PFN_vk##name name;
#include "layer/commands.def"
};

struct gn_device_next {
    PFN_vkGetDeviceProcAddr GetDeviceProcAddr;
#define GN_DEVICE_COMMAND(name) PFN_vk##name name;
#define GN_DEVICE_OWN(name) PFN_vk##name name; /* may be NULL */
#define GN_DEVICE_USED(name) PFN_vk##name name;
#include "layer/commands.def"
};

enum gn_checked {
#define GN_CHECKED(name, what) GN_CHECKED_##name,
#include "layer/tally.def"
    GN_CHECKED_COUNT
};

enum gn_unjudged {
#define GN_UNJUDGED(name, what, why) GN_UNJUDGED_##name,
#include "layer/tally.def"
    GN_UNJUDGED_COUNT
};

struct gn_tally {
    atomic_ullong checked[GN_CHECKED_COUNT];
    atomic_ullong unjudged[GN_UNJUDGED_COUNT];
};

struct gn_messenger {
    VkDebugUtilsMessengerEXT handle; /* VK_NULL_HANDLE: from the pNext chain of instance creation */
    VkDebugUtilsMessageSeverityFlagsEXT severities;
    VkDebugUtilsMessageTypeFlagsEXT types;
    PFN_vkDebugUtilsMessengerCallbackEXT callback;
    void *user_data;
};

struct gn_log;
struct gn_accesses;
struct gn_digest;
struct gn_barriers;
struct gn_batch;
struct gn_host_command;
struct gn_bound;
struct gn_findings;
struct gn_use;
struct gn_sarif;

struct gn_instance {
    VkInstance handle;
    pid_t process; /* that created it: a child of fork has it too, and says nothing of it */
    void *key;
    struct gn_instance_next next;
    bool debug_utils; /* the application enabled VK_EXT_debug_utils */
    struct gn_settings settings;
    uint32_t judged_commands; /* one bit per kind of command that an enabled rule is about */
    struct gn_tally tally;
    atomic_uint tracked_devices, passed_devices; /* ever created, with and without acceleration structures */
    atomic_ullong open_judgements;               /* TLAS builds submitted and neither judged nor given up */
    pthread_mutex_t lock;                        /* of everything below */
    struct gn_messenger *messengers;
    uint32_t messenger_count;
    struct gn_map sites; /* findings by site */
    struct gn_log *log;
    struct gn_sarif *sarif;
    const char *unjudged_extensions[16]; /* enabled by the application, recognised, not judged; static strings */
    uint32_t unjudged_extension_count;
    unsigned long long evaluated[256];   /* per rule of the catalogue */
    unsigned long long findings, sites_reported;
    char **stated;                       /* of shaders, for the closing statement: JSON objects */
    uint32_t stated_count;
    bool stated_left_out;                /* there were more */
    bool closed;
};

/* Queues beyond these are not told apart in time: nothing is said about them. */
#define GN_MAX_CLOCKS 16u

/* Per queue the position up to which everything has happened. */
struct gn_clock {
    uint64_t at[GN_MAX_CLOCKS];
};

struct gn_dependency;
/* The barriers and waits of a queue, in the order of execution (sync.c). What came up to `forgotten` counts as ordered. */
struct gn_dependencies {
    struct gn_dependency *list;
    uint32_t count, capacity, swept;
    uint64_t forgotten;
};

/* The queue id of what the host executes. Queues of the device count from 1. */
#define GN_QUEUE_HOST 0

/* The first and the last time that one queue wrote a structure. */
struct gn_built_on {
    uint32_t queue;
    uint64_t position, last;
};

/* What one recorded build was told. Shared by the event and by every structure that comes from it. */
struct gn_build_shape {
    uint32_t references;
    struct gn_shape shape;
    struct gn_geometry geometries[];
};

/* What a structure was created as; of a GENERIC one, everything that it was built as, and both before that is known. */
#define GN_LEVEL_BOTTOM 1u
#define GN_LEVEL_TOP 2u

/* One execution of something that wrote a structure. */
struct gn_write {
    uint64_t position, submission;
    uint32_t queue;
    uint32_t role; /* enum gn_role */
    const char *command;
    VkCommandBuffer command_buffer;
};

/* What a TLAS was last built from, and what has happened to that since (contents.c). */
enum gn_change_kind { GN_CHANGE_WRITTEN, GN_CHANGE_DESTROYED, GN_CHANGE_STORAGE_GONE, GN_CHANGE_COUNT };
struct gn_members {
    uint64_t version; /* of the TLAS: its `writes` after the build */
    uint32_t queue;
    uint64_t position;
    bool complete;    /* every change after the build was or will be seen */
    uint64_t next_change;
    struct gn_map index; /* id -> index + 1 */
    struct gn_as **structures;
    uint32_t count;
    uint64_t changed[GN_CHANGE_COUNT];
    const struct gn_as *first[GN_CHANGE_COUNT]; /* to which it happened first */
};
struct gn_change {
    uint64_t id, position;
    uint32_t queue;
    enum gn_change_kind kind;
};
/* What has happened to BLASes, in the order of positions; the oldest are dropped. */
struct gn_changes {
    struct gn_change *list;
    uint32_t count, capacity;
    uint64_t dropped, dropped_position;
};

/* Of instances whose BLAS has several geometries: for a geometry, the highest shader-binding-table offset, and who has it. */
struct gn_reaches {
    uint32_t count;
    struct gn_reach {
        uint32_t geometry, offset, instance;
    } list[4];
};

/* An acceleration structure. Lives on after its destruction while a recording or a judgement refers to it. */
struct gn_as {
    VkAccelerationStructureKHR handle;
    uint64_t id;
    enum gn_object_kind kind; /* of a GENERIC structure: what it was built as, GN_OBJECT_STRUCTURE before that */
    uint64_t address;         /* 0 until it is known */
    struct gn_as *same_address;
    uint64_t created_at, destroyed_at; /* destroyed_at is 0 while it is alive */
    bool generic;
    uint8_t levels;                    /* GN_LEVEL_*: of which levels it may be */
    uint64_t mark;                     /* the position of the command last judged that writes it beside a TLAS */
    uint32_t table_id;                 /* in the table that shaders look at (mirror.c) */
    uint32_t positions, positions_list;/* what its word says of vertex positions, and where the last list of its instances is (positions.c) */
    bool allowed_positions;            /* when it was last written */
    bool shared;                       /* its memory may be written under another name: nothing is known for sure */
    VkDeviceSize size;                 /* as it was created */
    /* What it holds, as of what was replayed last; with several writers in no known order, gn_as_sure is false. */
    uint64_t generation;               /* counts builds and copies into it; updates in place belong to the same one */
    enum gn_made made;
    bool compacted;
    struct gn_build_shape *shape;      /* of the build that the contents come from; NULL: not known */
    uint64_t base;                     /* of its memory; a range of its own where that has no address */
    struct gn_write last_writes[4];    /* a ring, by `writes` */
    struct gn_digest *digests;         /* of what its last build or update has read (refit.c) */
    uint32_t digest_count;
    uint64_t writes;                   /* counts everything that was written into it */
    struct gn_members *members;        /* of a TLAS, once a build of it was judged */
    uint64_t used_in, used_version;    /* the submission that read it last, and what it read */
    bool used_certainly;
    uint32_t judging;                  /* builds of it that wait to be judged */
    char *moved_to;                    /* what it was copied into last, for messages; NULL: nothing */
    struct gn_buffer *buffer;          /* that it lies in; NULL: not known, or gone */
    struct gn_as *buffer_next, *buffer_previous;
    bool storage_gone;                 /* the buffer or its memory is no more */
    uint64_t compacted_size;           /* the last that the application has read; 0: none */
    uint64_t compacted_size_of;        /* the generation that it belongs to */
    uint64_t size_asked_of;            /* the generation whose compacted size was last asked */
    struct gn_built_on *built;
    uint32_t built_count;
    uint32_t references;
    char *name;
    struct gn_instance_tag *tag;       /* what its instances are declared to hold; NULL: the settings say it */
    uint32_t highest_offset, highest_offset_at; /* the highest shader-binding-table offset of its instances, and who has it */
    uint64_t highest_offset_of;        /* the write that this is about; 0: not known */
    struct gn_reaches *reaches;        /* the same of instances with several geometries; NULL: there are none */
    struct gn_as *next_destroyed;
};

/* A buffer that has an address, or holds structures. */
struct gn_buffer {
    VkBuffer handle;
    VkDeviceSize size;
    VkBufferUsageFlags2 usage; /* as the application asked for it */
    uint64_t address;  /* 0: not known, or not asked */
    bool has_address;  /* created with device-address usage */
    bool build_input;
    bool storage;      /* of structures */
    bool can_copy;     /* has TRANSFER_SRC usage, by itself or by the layer */
    bool bound;
    bool external;     /* may be shared with another API or process */
    struct gn_range range; /* in gn_device.inputs once it has an address: build input, else in gn_device.others */
    char *name;
    struct gn_as *first_structure; /* that lies in it */
    VkDeviceMemory memory; /* that it is bound to */
    struct gn_buffer *memory_next, *memory_previous; /* of the buffers with structures in the same memory */
};

struct gn_staging_block;

/* What one recorded command reads from memory, as the GPU copies it: the instance records of a TLAS build, or a geometry of a BLAS
 * build. */
struct gn_sbt_capture;
struct gn_indirect_build;
struct gn_capture {
    struct gn_staging_block *block;
    VkDeviceSize offset;
    union {
        const unsigned char *bytes;
        const struct gn_instance_record *records;
    };
    uint32_t record_count;
    bool partial; /* the build reads more than these */
    uint32_t info, geometry; /* pInfos[info].pGeometries[geometry] */
    struct gn_geometry_contents *contents; /* of a geometry; else NULL */
    struct gn_sbt_capture *sbt;            /* of a trace */
    struct gn_indirect_build *indirect;    /* of an indirect build; NULL in all three: instance records */
    struct gn_judgement *pending;
    struct gn_capture *next;               /* of the same event */
};

/* Copies that are recorded before the command which reads the same memory. */
struct gn_copy {
    VkBuffer from, to;
    VkBufferCopy region;
};

struct gn_copies {
    struct gn_copy *list; /* `few` until they are more */
    uint32_t count, capacity;
    struct gn_copy few[8];
};

enum gn_event_kind {
    GN_EVENT_BUILD,
    GN_EVENT_UPDATE,
    GN_EVENT_INDIRECT_BUILD,
    GN_EVENT_COPY,
    GN_EVENT_COMPACT,
    GN_EVENT_DESERIALIZE,
    GN_EVENT_SERIALIZE,
    GN_EVENT_QUERY_COMPACTED, /* a question for the compacted size */
    GN_EVENT_QUERY,           /* for another property */
    GN_EVENT_BARRIER,
    GN_EVENT_ACCESS,          /* another access to memory that builds and traces read */
    GN_EVENT_USE,             /* a trace, dispatch or draw that may read TLASes */
    GN_EVENT_TRACE,           /* a trace with its shader binding table */
    GN_EVENT_EXECUTE
};

/* What was wrong with a build as it was recorded, for the rules to say when it is executed. */
enum gn_fault_kind { GN_FAULT_INPUT, GN_FAULT_CLASH, GN_FAULT_DEMAND };
struct gn_fault {
    enum gn_fault_kind kind;
    union {
        struct gn_input input;
        struct gn_clash clash;
        struct gn_demand demand;
    } of;
    struct gn_as *structures[2]; /* whose names are in it */
    struct gn_fault *next;
};

/* Something recorded. Events of one command share `command`, and later a position. */
struct gn_event {
    enum gn_event_kind kind;
    uint32_t command;
    struct gn_as *target; /* written; NULL if none */
    struct gn_as *source; /* read; NULL if none */
    bool is_tlas;                 /* a build or update of a TLAS */
    struct gn_capture *capture;   /* what is copied, to be judged; NULL: nothing */
    enum gn_unjudged unjudged;    /* of a TLAS build that is not judged: why; else GN_UNJUDGED_COUNT */
    bool is_update;               /* of an indirect build, whose kind does not say */
    struct gn_build_shape *shape; /* of a build or update; NULL: not known */
    struct gn_query_pool *pool;   /* of a question for the compacted size; NULL: not known */
    uint32_t query;
    struct gn_fault *faults;
    struct gn_use *use;
    struct gn_accesses *accesses;
    struct gn_barriers *barriers;
    struct gn_recording *secondary;
};

/* A slot of a pool for compacted sizes: of what the size was last asked. */
struct gn_query_slot {
    struct gn_as *as;
    uint64_t generation;
    bool ambiguous; /* asked again before the last answer was read: an answer may be the old one */
};

struct gn_query_pool {
    VkQueryPool handle;
    uint32_t references;
    uint32_t count;
    struct gn_query_slot slots[];
};

/* What one recording of a command buffer holds. Shared by the command buffer, by primaries that execute it, and by
 * judgements under way. */
struct gn_recording {
    uint32_t references;
    bool simultaneous;
    bool launches; /* something that shaders have to be told of (launch.c) */
    uint32_t command_count;
    struct gn_event *events;
    uint32_t count, capacity;
};

struct gn_command_buffer {
    VkCommandBuffer handle;
    struct gn_command_pool *pool;
    struct gn_command_buffer *previous, *next;
    bool simultaneous;
    VkRenderPass render_pass; /* begun last */
    struct gn_recording *recording; /* NULL until something is recorded */
    struct gn_rays *rays;           /* the ray-tracing pipeline that is bound; NULL: not known */
    struct gn_bound *bound; /* NULL until something that holds TLASes, or traces through them, is bound */
    char *name;
};

struct gn_command_pool {
    VkCommandPool handle;
    bool is_protected;
    struct gn_command_buffer *first;
};

/* One execution of a TLAS build, to be judged once its submission has completed. */
struct gn_judgement {
    struct gn_recording *recording; /* a reference, for it owns the capture */
    struct gn_capture *capture;
    struct gn_as *tlas;
    uint32_t event; /* its index in the recording */
    VkCommandBuffer command_buffer;
    uint32_t queue;
    uint64_t position;
    uint64_t submission;
    uint64_t version; /* of the TLAS, once it is built */
    struct gn_clock host; /* what the host knew to be over when it submitted */
    struct gn_clock seen; /* what had happened in other queues */
    struct gn_as *source; /* of an update; NULL: a build, or not known for sure */
    uint64_t source_version;
    bool may_update; /* an update may follow, or this is one */
    struct gn_judgement *next;
};

/* A finding about a command, made when its submission was replayed. It is reported once the submission has completed, if nothing
 * was learned by then that may have put the structures into another state. */
struct gn_suspicion {
    struct gn_pending_finding *finding;
    struct gn_as *structures[2]; /* NULL if not concerned */
    uint32_t queue;
    uint64_t position;
    struct gn_clock seen; /* what had happened in other queues */
    struct gn_suspicion *next;
};

/* A command that reads a TLAS of which it is not known yet what it was built from. */
struct gn_pending_use {
    struct gn_as *tlas;
    uint64_t version, position;
    uint32_t queue;
    bool certain;
    struct gn_clock seen;
    struct gn_pending_use *next;
    char place[]; /* of the command */
};

struct gn_submission {
    uint64_t number;
    uint64_t first_position;
    VkFence fence;
    bool owned;    /* the fence is the layer's */
    bool accepted; /* the next layer has returned success: the fence may be asked */
    bool done;
    uint32_t held; /* batches that are not replayed yet */
    struct gn_clock host; /* what the host knew to be over when it submitted */
    struct gn_judgement *judgements, **last;
    struct gn_suspicion *suspicions, **last_suspicion;
    struct gn_pending_use *uses, **last_use;
    struct gn_submission *next;
};

struct gn_queue {
    VkQueue handle;
    uint32_t id;
    char *name;
    struct gn_submission *oldest, **newest; /* those that still wait to be judged */
    struct gn_batch *held, **last_held;     /* what waits for something that is not submitted yet */
    struct gn_clock clock;                  /* what comes before the next batch, itself included */
    struct gn_queue *next;
};

struct gn_device {
    VkDevice handle;
    void *key;
    struct gn_instance *instance;
    VkPhysicalDevice physical;
    struct gn_device_next next;
    bool tracked;            /* has acceleration structures; nothing below is in use otherwise */
    bool copies;             /* instance records can be copied on this device */
    enum gn_unjudged no_copies_because;
    bool builds_unseen;      /* an extension creates or builds structures by commands that the layer does not see */
    VkPhysicalDeviceMemoryProperties memory;
    uint32_t families[16];   /* the queue families in use; beyond these nothing is copied */
    uint32_t family_count;
    atomic_uint pending;     /* submissions that wait to be judged */
    atomic_bool traces;      /* some pipeline traces through a descriptor that is followed */
    atomic_bool ray_pipelines; /* there have been some */
    atomic_bool mutable_descriptors; /* some binding holds acceleration structures or something else */
    atomic_bool incomplete;  /* the layer ran out of memory: it may have missed a build, and accuses nobody any more */

    pthread_mutex_t lock;    /* of everything below */
    uint64_t position;
    uint64_t submission_count;
    struct gn_map buffers, structures, addresses, pools, command_buffers, queues, query_pools;
    struct gn_map memories; /* VkDeviceMemory -> the first buffer with structures in it */
    struct gn_map set_layouts, pipeline_layouts, sets, set_pools, update_templates, modules, pipelines;
    struct gn_changes changes;
    uint64_t buffers_gone;   /* destroyed so far: what was known of addresses before may not hold any more */
    struct gn_ranges inputs, others; /* buffers with an address: with build-input usage, and without */
    VkPhysicalDeviceAccelerationStructurePropertiesKHR limits;
    struct gn_map semaphores, fence_clocks, render_passes;
    struct gn_host_command *host_commands; /* under deferred operations */
    struct gn_clock host; /* what the host knows to be over */
    bool order_unknown;   /* something that is not observed orders queues */
    struct gn_ranges touches; /* accesses that may be under way (sync.c) */
    uint32_t touch_count, swept;
    struct gn_dependencies dependencies[GN_MAX_CLOCKS]; /* by queue */
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR ray_limits; /* all 0 without such pipelines */
    struct gn_map rays;           /* struct gn_rays by VkPipeline */
    struct gn_rays *first_rays;   /* the same, as a list */
    struct gn_rays *former_rays[32]; /* those destroyed last, so that a finding can name them; a ring */
    uint32_t former_ray_count;
    uint64_t ray_ids;
    struct gn_queue *first_queue;
    uint32_t queue_count;
    struct gn_as *destroyed; /* still in `addresses` because a judgement may need them */
    struct gn_as *graves[64]; /* the structures destroyed last, so that a finding can name them; a ring */
    uint32_t grave_count;
    uint32_t addressless;     /* structures alive whose address is not known */
    uint32_t valid_instance_flags;
    struct gn_staging_block *blocks;
    VkDeviceSize idle_staging;
    VkFence *fences; /* the layer's own, not in use by a submission it still watches */
    uint32_t fence_count, fence_capacity;
    struct gn_shaders *shaders; /* shader.h; NULL: shaders are left alone. Set as long as the device lives */
};

/* entry.c: from a dispatchable handle to the state; NULL when the layer does not know it. */
struct gn_instance *gn_instance_of(const void *dispatchable);
struct gn_device *gn_device_of(const void *dispatchable);
bool gn_instance_register(struct gn_instance *instance);
void gn_instance_forget(struct gn_instance *instance);
bool gn_device_register(struct gn_device *device);
/* Every device of the instance; no other may come or go meanwhile. */
void gn_devices_each(const struct gn_instance *instance, void (*visit)(struct gn_device *device));
void gn_device_forget(struct gn_device *device);

/* chain.c: the structure of that type in a pNext chain, NULL if there is none. */
const void *gn_chain_find(const void *chain, VkStructureType type);
#define GN_CHAIN_BYTES 8192
struct gn_chain_copy {
    size_t used; /* 0 before the first copy */
    uint64_t bytes[GN_CHAIN_BYTES / 8];
};
/* Copies the chain up to the first structure of that type, so that it can be changed, makes *chain begin with the copies, and returns the
 * copy of the structure. NULL if it is not there, or behind one whose size is not known; then *chain is as it was. */
void *gn_chain_copy(const void **chain, VkStructureType type, struct gn_chain_copy *storage);

/* instance.c: of every instance alive. Closing is for the end of the process: nothing of Vulkan is called, and no messenger. */
void gn_instances_close(const char *ending);
void gn_instances_state(const char *ending);

/* signals.c: makes the process's signals do what the settings say. False if the application has a handler of its own for the statement
 * signal. */
bool gn_signals_watch(const struct gn_settings *settings);

/* device.c */
static inline void gn_tally_check(struct gn_device *device, enum gn_checked what, uint64_t count)
{
    atomic_fetch_add_explicit(&device->instance->tally.checked[what], count, memory_order_relaxed);
}
static inline void gn_tally_unjudged(struct gn_device *device, enum gn_unjudged what, uint64_t count)
{
    atomic_fetch_add_explicit(&device->instance->tally.unjudged[what], count, memory_order_relaxed);
}
/* Something was not recorded. */
static inline void gn_tally_lost(struct gn_device *device)
{
    atomic_store_explicit(&device->incomplete, true, memory_order_relaxed);
    gn_tally_unjudged(device, GN_UNJUDGED_out_of_host_memory, 1);
}
static inline void gn_lock(struct gn_device *device)
{
    pthread_mutex_lock(&device->lock);
}
static inline void gn_unlock(struct gn_device *device)
{
    pthread_mutex_unlock(&device->lock);
}

/* buffer.c; with the device locked. */
void gn_buffers_finish(struct gn_device *device);
/* A structure is created in the buffer, or destroyed. */
void gn_buffer_holds(struct gn_buffer *buffer, struct gn_as *as);
void gn_buffer_lets_go(struct gn_as *as);
struct gn_buffer *gn_buffer_holding(struct gn_device *device, uint64_t address, uint64_t size);
/* Whether some buffer around the address has the usage; `out_known` gives one that is around it, NULL if there is none. */
bool gn_buffer_has_usage(struct gn_device *device, uint64_t address, VkBufferUsageFlags2 usage, struct gn_buffer **out_known);
/* The highest address that a buffer around `address` reaches; not above it: there is none. */
uint64_t gn_buffers_end(const struct gn_device *device, uint64_t address);
/* Among those without build-input usage. */
struct gn_buffer *gn_buffer_other(struct gn_device *device, uint64_t address, uint64_t size);

/* positions.c; with the device locked: something was written, and the build of a TLAS was judged that nothing has written since. */
void gn_positions_written(struct gn_device *device, struct gn_as *as);
void gn_positions_judged(struct gn_device *device, struct gn_as *tlas, uint64_t position, const struct gn_as *const *owners,
                         uint32_t owner_count, const uint32_t *refers_to, uint32_t count);

/* launch.c; with the device locked: the queue runs traces whose shaders were told of them. */
void gn_launch_executed(struct gn_device *device, uint32_t queue);

/* capture.c; with the device locked. */
void gn_copies_init(struct gn_copies *copies);
void gn_copies_finish(struct gn_copies *copies);
bool gn_copies_add(struct gn_copies *copies, VkBuffer from, VkBuffer to, const VkBufferCopy *region);
/* Prepares to read the geometries of a BLAS build: the captures become a list, the copies are added. */
void gn_geometry_capture(struct gn_device *device, const struct gn_command_buffer *commands,
                         const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_capture **out, struct gn_copies *copies);
/* indirect.c: prepares to read the ranges of an indirect build, and its instances. GN_UNJUDGED_COUNT: nothing stands against it. */
enum gn_unjudged gn_indirect_capture(struct gn_device *device, const struct gn_command_buffer *commands,
                                     const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index, VkDeviceAddress address,
                                     uint32_t stride, const uint32_t *maxima, struct gn_capture **out, struct gn_copies *copies);
/* Judges the ranges, and gives the instances that were read of a TLAS; NULL: none are to be judged. */
const struct gn_instance_record *gn_indirect_judge(struct gn_device *device, const struct gn_judgement *judgement, const char *place,
                                                   uint32_t *out_count, bool *out_partial, struct gn_findings *out);
/* Of one event: gives the staging memory back and frees the list. */
void gn_captures_free(struct gn_device *device, struct gn_capture *capture);
/* record.c, without the lock: records the copies before a command that reads the same memory in the stage `reader`. */
void gn_copies_record(struct gn_device *device, VkCommandBuffer handle, const struct gn_copies *copies, VkPipelineStageFlags reader,
                      bool simultaneous);
/* rays.c: of the bytes of a shader group handle. */
uint64_t gn_handle_hash(const unsigned char *handle, uint32_t size);
/* How the vertices of a format lie in memory: bytes of a component (0: the format is not known), how many count as coordinates, bytes of
 * the whole, and whether components are floating-point numbers. */
struct gn_vertex_layout {
    uint32_t component_size, coordinates, size;
    bool floating;
};
struct gn_vertex_layout gn_vertex_layout_of(VkFormat format);
/* Bytes of an index; 0: there are none, or the type is not known. */
uint32_t gn_index_size(VkIndexType type);

/* structure.c; with the device locked. */
struct gn_as *gn_as_get(struct gn_device *device, VkAccelerationStructureKHR handle);
struct gn_as *gn_as_keep(struct gn_as *as);
void gn_as_release(struct gn_as *as);
/* Records that something with `queue` and `position` wrote the structure. */
void gn_as_written(struct gn_device *device, struct gn_as *as, uint32_t queue, uint64_t position);
/* Says what that was. The shape is kept; NULL: not known. */
void gn_as_holds(struct gn_as *as, enum gn_made made, bool compacted, struct gn_build_shape *shape);
/* Whether all that is known to have written the structure is ordered against an event of `queue` at `position`, which comes after what
 * the clock says of the other queues (NULL: not known). */
bool gn_as_sure(const struct gn_as *as, uint32_t queue, uint64_t position, const struct gn_clock *seen);
struct gn_build_shape *gn_shape_create(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                       const VkAccelerationStructureBuildRangeInfoKHR *ranges);
struct gn_build_shape *gn_shape_keep(struct gn_build_shape *shape);
void gn_shape_release(struct gn_build_shape *shape);
/* The state of the build of `as`, seen from `queue` at `position`. */
enum gn_built gn_as_built(const struct gn_as *as, uint32_t queue, uint64_t position, const struct gn_clock *seen);
/* The structure that owned `address` for an event at `position`; where several did, the one whose build speaks best. */
struct gn_as *gn_as_at(struct gn_device *device, uint64_t address, uint32_t queue, uint64_t position, const struct gn_clock *seen);
/* A structure of GENERIC type is now also known as one of `levels`. */
static inline void gn_as_level(struct gn_as *as, unsigned levels)
{
    if (as->generic)
        as->levels |= (uint8_t)levels;
}
/* The structure destroyed last that had `address`; NULL if it is not remembered. */
const struct gn_as *gn_as_formerly_at(const struct gn_device *device, uint64_t address);
/* Frees destroyed structures that no judgement can ask for any more. */
void gn_as_purge(struct gn_device *device);
void gn_as_finish(struct gn_device *device);

/* contents.c; with the device locked. Changes are told in the order of positions. */
void gn_members_set(struct gn_device *device, struct gn_as *tlas, uint64_t version, uint32_t queue, uint64_t position,
                    const struct gn_as *const *structures, uint32_t count);
void gn_members_free(struct gn_members *members);
/* Counts what has happened before `position`; false if that is not known any more. */
bool gn_members_look(struct gn_device *device, struct gn_members *members, uint32_t queue, uint64_t position,
                     const struct gn_clock *seen);
void gn_change_add(struct gn_device *device, const struct gn_as *as, enum gn_change_kind kind, uint32_t queue,
                   uint64_t position);
void gn_changes_finish(struct gn_device *device);

/* semaphore.c; with the device locked. */
bool gn_semaphore_ready(const struct gn_device *device, VkSemaphore handle, uint64_t value);
/* What has happened before whoever waits. */
struct gn_clock gn_semaphore_wait(struct gn_device *device, VkSemaphore handle, uint64_t value);
void gn_semaphore_signal(struct gn_device *device, VkSemaphore handle, uint64_t value, const struct gn_clock *clock);
void gn_fence_submitted(struct gn_device *device, VkFence fence, const struct gn_clock *clock);
void gn_fence_seen(struct gn_device *device, VkFence fence);
void gn_semaphores_finish(struct gn_device *device);
/* Not locked: the host has learnt something in a way that is not looked into. */
void gn_host_saw_all(struct gn_device *device);

/* order.c; with the device locked: whether what wrote the BLASes of a TLAS build comes before it. */
void gn_order_instances(struct gn_device *device, const struct gn_as *const *structures, uint32_t count,
                        const struct gn_judgement *judgement, const char *place, struct gn_findings *out);

/* refit.c; with the device locked. */
void gn_digests_free(struct gn_as *as);
/* Holds what an update has read against what came before. */
void gn_refit_geometry(struct gn_device *device, const struct gn_judgement *judgement, const struct gn_geometry_contents *contents,
                       const char *place, struct gn_findings *out);

/* barrier.c */
void gn_render_passes_finish(struct gn_device *device);

/* use.c, descriptor.c, module.c; with the device locked. */
void gn_use_free(struct gn_use *use);
int gn_use_troubles(struct gn_device *device, struct gn_as *tlas, uint64_t version, uint32_t queue, uint64_t position,
                    const struct gn_clock *seen, bool certain, struct gn_trouble out[GN_TROUBLE_KINDS]);
void gn_bound_free(struct gn_bound *bound);
void gn_descriptors_finish(struct gn_device *device);
void gn_modules_finish(struct gn_device *device);

/* record.c; with the device locked. */
struct gn_command_buffer *gn_command_buffer_get(struct gn_device *device, VkCommandBuffer handle);
struct gn_recording *gn_recording_keep(struct gn_recording *recording);
void gn_recording_release(struct gn_device *device, struct gn_recording *recording);
/* Appends an event to what the command buffer records, keeping what it refers to; NULL without memory, which is counted. */
/* The number that the events of the next command share. */
uint32_t gn_command_buffer_next(struct gn_command_buffer *commands);
struct gn_event *gn_command_buffer_add(struct gn_device *device, struct gn_command_buffer *commands,
                                       const struct gn_event *event);
void gn_command_buffers_finish(struct gn_device *device);

/* inputs.c: what can be said of a build as soon as it is recorded; with the device locked. Faults are appended to *out. */
void gn_inputs_check(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                     const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_fault **out);
/* Finds the elements of one command that use the same memory; `out` has a list per element. */
void gn_inputs_check_together(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                              const VkAccelerationStructureBuildRangeInfoKHR *const *ranges, uint32_t count,
                              struct gn_fault **out);
void gn_faults_free(struct gn_fault *fault);
/* replay.c: of a command that has been executed. */
void gn_fault_report(struct gn_device *device, struct gn_fault *fault, const char *place, struct gn_findings *out);
/* The bytes of scratch memory that the driver wants for the build; without an answer none. */
uint64_t gn_inputs_scratch_size(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                const VkAccelerationStructureBuildRangeInfoKHR *ranges);

/* host.c; with the device locked. */
void gn_host_commands_finish(struct gn_device *device);

/* query.c: pools for compacted sizes; with the device locked. */
struct gn_query_pool *gn_query_pool_get(struct gn_device *device, VkQueryPool handle);
struct gn_query_pool *gn_query_pool_keep(struct gn_query_pool *pool);
void gn_query_pool_release(struct gn_query_pool *pool);
/* The compacted size of what `as` holds is asked, and will be found in `slot`. */
void gn_query_asked(struct gn_query_pool *pool, uint32_t slot, struct gn_as *as);
void gn_query_pools_finish(struct gn_device *device);

/* staging.c: host-visible memory of the layer; with the device locked. */
bool gn_staging_take(struct gn_device *device, VkDeviceSize size, struct gn_capture *out);
VkBuffer gn_staging_buffer(const struct gn_capture *capture);
void gn_staging_give(struct gn_device *device, const struct gn_capture *capture);
void gn_staging_finish(struct gn_device *device);

/* submit.c; only the first is called with the device locked. */
struct gn_queue *gn_queue_get(struct gn_device *device, VkQueue handle);
/* Replays what was held back, as far as it can go by now. */
void gn_queues_resume(struct gn_device *device);
/* Judges what has completed. */
void gn_device_collect(struct gn_device *device);
/* Judges what is left when the device ends, and frees the queues. */
void gn_queues_finish(struct gn_device *device);

/* judge.c; with the device locked, so that neither the objects nor the copied records change under the rules. Findings are
 * collected, and reported once the lock is released: a messenger of the application may take locks of its own. */
struct gn_findings;
void gn_judge_capture(struct gn_device *device, const struct gn_judgement *judgement, struct gn_findings *out);
/* A TLAS build on the host, whose references are handles. */
void gn_judge_host(struct gn_device *device, struct gn_as *tlas, const struct gn_instance_record *records, uint32_t count,
                   bool partial, uint64_t position, uint32_t info, struct gn_findings *out);

/* report.c */
struct gn_pending_finding;
struct gn_findings {
    struct gn_pending_finding *first, **last;
};
/* Runs the rules about a command. What they find is not counted yet: gn_report_confirm does that, and moves what is new to `out`. The
 * place of the command is asked only if there is something to find. */
struct gn_suspect {
    void (*judge)(const void *value, struct gn_report *report);
    const void *value;
    const char **place; /* the member of the value */
    const char *(*make_place)(void *context);
    void *context;
};
void gn_report_suspect(struct gn_instance *instance, const struct gn_suspect *suspect, struct gn_findings *out);
void gn_report_confirm(struct gn_instance *instance, struct gn_pending_finding *finding, struct gn_findings *out);
struct gn_pending_finding *gn_findings_take(struct gn_findings *findings);
void gn_findings_init(struct gn_findings *findings);
/* A finding that happened `times` times at that site: counts it, and adds it to `out` if it is new. */
void gn_report_found(struct gn_instance *instance, const struct gn_finding *finding, uint64_t site, uint64_t times,
                     struct gn_findings *out);
/* Runs the rules, collecting what is new and counting what is known. */
void gn_report_judge(struct gn_instance *instance, const struct gn_tlas_build *build, struct gn_findings *out);
void gn_report_sbt(struct gn_instance *instance, const struct gn_sbt *sbt, struct gn_findings *out);
void gn_report_demand(struct gn_instance *instance, const struct gn_demand *demand, struct gn_findings *out);
void gn_report_geometry(struct gn_instance *instance, const struct gn_geometry_contents *contents, struct gn_findings *out);
/* Gives the findings to every sink and empties the list. Without any lock. */
void gn_report_flush(struct gn_instance *instance, struct gn_findings *findings);
/* A message about the layer's own conduct (its settings, say) to messengers and stderr. */
void gn_report_say(struct gn_instance *instance, enum gn_severity severity, const char *id, const char *text);
/* The last counts and the closing statement to every sink, once. `ending` says how it came to this. */
void gn_report_close(struct gn_instance *instance, const char *ending);
/* What there is to state so far, to stderr and the log: messengers are for the application's own threads. */
void gn_report_state(struct gn_instance *instance, const char *ending);
void gn_messenger_add(struct gn_instance *instance, VkDebugUtilsMessengerEXT handle,
                      const VkDebugUtilsMessengerCreateInfoEXT *info);
void gn_messenger_remove(struct gn_instance *instance, VkDebugUtilsMessengerEXT handle);

#endif
