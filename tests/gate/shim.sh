# SPDX-License-Identifier: Apache-2.0
# For scripts: shim LIBRARY writes shim_icd.json into this folder, a driver that is the library of shim.c before lavapipe,
# and sets `icd` to lavapipe's own file.
shim() {
    icd=${GNOMON_LAVAPIPE_ICD:-${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}}
    GNOMON_SHIM_DRIVER=$(sed -n 's/.*"library_path"[^"]*"\([^"]*\)".*/\1/p' "$icd")
    case $GNOMON_SHIM_DRIVER in
    /*) ;;
    */*) GNOMON_SHIM_DRIVER=$(dirname "$icd")/$GNOMON_SHIM_DRIVER ;;
    esac
    export GNOMON_SHIM_DRIVER
    sed "s|\(\"library_path\"[^\"]*\"\)[^\"]*\"|\1$1\"|" "$icd" >shim_icd.json
}
