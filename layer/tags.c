/* SPDX-License-Identifier: Apache-2.0 */
/* Tags of objects: what an application declares of the instances of a TLAS (checks/rules/instance.h). */
#include "layer/layer.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_SetDebugUtilsObjectTagEXT(VkDevice handle, const VkDebugUtilsObjectTagInfoEXT *info)
{
    struct gn_device *device = gn_device_of(handle);
    bool ours = device->tracked && info->objectType == VK_OBJECT_TYPE_ACCELERATION_STRUCTURE_KHR && info->tagName == GN_INSTANCE_TAG;
    if (ours && info->tagSize == sizeof(struct gn_instance_tag) && info->pTag) {
        struct gn_instance_tag *tag = malloc(sizeof *tag);
        if (tag)
            memcpy(tag, info->pTag, sizeof *tag);
        gn_lock(device);
        struct gn_as *as = gn_as_get(device, (VkAccelerationStructureKHR)info->objectHandle);
        if (as && tag) {
            struct gn_instance_tag *old = as->tag;
            as->tag = tag;
            tag = old;
        }
        gn_unlock(device);
        free(tag);
    } else if (ours) {
        char text[160];
        snprintf(text, sizeof text, "the tag of an acceleration structure has %zu bytes, but struct gn_instance_tag has %zu. It is ignored.",
                 info->tagSize, sizeof(struct gn_instance_tag));
        gn_report_say(device->instance, GN_SEVERITY_WARNING, "tag", text);
    }
    return device->next.SetDebugUtilsObjectTagEXT ? device->next.SetDebugUtilsObjectTagEXT(handle, info) : VK_SUCCESS;
}
