# SPDX-License-Identifier: Apache-2.0
# The reference as a library of its own: cmake --install BUILD --component reference [--prefix PREFIX]
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# The objects of the static library, and what the headers declare of them.
add_library(gnomon_reference_shared SHARED $<TARGET_OBJECTS:gnomon_reference>)
target_link_libraries(gnomon_reference_shared PRIVATE PkgConfig::GMP embree m Threads::Threads)
target_link_options(gnomon_reference_shared PRIVATE -Wl,--version-script=${CMAKE_CURRENT_SOURCE_DIR}/exports.map)
set_target_properties(gnomon_reference_shared PROPERTIES LINK_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/exports.map)
set_target_properties(gnomon_reference_shared PROPERTIES OUTPUT_NAME gnomon_reference LINKER_LANGUAGE C
                      VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR} EXPORT_NAME reference-shared)
set_target_properties(gnomon_reference PROPERTIES EXPORT_NAME reference)

# Headers include one another as "reference/x.h", in the tree and installed.
set(GN_REFERENCE_INCLUDE ${CMAKE_INSTALL_INCLUDEDIR}/gnomon)
foreach(target gnomon_reference gnomon_reference_shared)
  target_include_directories(${target} INTERFACE $<INSTALL_INTERFACE:${GN_REFERENCE_INCLUDE}>)
endforeach()
set(GN_REFERENCE_HEADERS effects.h scene.h trace.h tracer.h verdict.h)
install(FILES ${GN_REFERENCE_HEADERS} DESTINATION ${GN_REFERENCE_INCLUDE}/reference COMPONENT reference)
install(TARGETS gnomon_reference gnomon_reference_shared EXPORT gnomon-reference
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT reference
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT reference NAMELINK_COMPONENT reference)

set(GN_REFERENCE_CMAKE ${CMAKE_INSTALL_LIBDIR}/cmake/gnomon-reference)
install(EXPORT gnomon-reference NAMESPACE gnomon:: FILE gnomon-reference-targets.cmake
        DESTINATION ${GN_REFERENCE_CMAKE} COMPONENT reference)
configure_package_config_file(gnomon-reference-config.cmake.in gnomon-reference-config.cmake
                              INSTALL_DESTINATION ${GN_REFERENCE_CMAKE})
write_basic_package_version_file(gnomon-reference-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/gnomon-reference-config.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/gnomon-reference-config-version.cmake
        DESTINATION ${GN_REFERENCE_CMAKE} COMPONENT reference)

# Relative to the file itself: the install tree may be moved.
file(RELATIVE_PATH GN_REFERENCE_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(gnomon-reference.pc.in gnomon-reference.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/gnomon-reference.pc
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT reference)
