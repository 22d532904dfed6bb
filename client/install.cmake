# find_package(Clearance) -> Clearance::client: static libraries, their headers, what they need.
# find_package(Clearance COMPONENTS mirror) -> Clearance::mirror too, which needs OpenVDB and TBB.
include(CMakePackageConfigHelpers)
set(sdk_targets clearance_client clearance_wire clearance_proto clearance_core clearance_flags)
set(mirror_targets clearance_mirror clearance_query clearance_map)
foreach(target ${sdk_targets} ${mirror_targets})
  string(REPLACE "clearance_" "" exported ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${exported})
endforeach()
install(TARGETS ${sdk_targets} EXPORT ClearanceTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT sdk)
install(TARGETS ${mirror_targets} EXPORT ClearanceMirrorTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT sdk)

set(include_root ${CMAKE_INSTALL_INCLUDEDIR}/clearance)
install(FILES credentials.h distance_source.h esdf_client.h ingest_stream.h query_stream.h types.h watch.h
        DESTINATION ${include_root}/client COMPONENT sdk)
install(FILES mirror/mirror.h DESTINATION ${include_root}/client/mirror COMPONENT sdk)
foreach(folder proto/wire server/core server/map server/query)
  install(DIRECTORY ${CMAKE_SOURCE_DIR}/${folder}/ DESTINATION ${include_root}/${folder}
          COMPONENT sdk FILES_MATCHING PATTERN "*.h")
endforeach()
install(DIRECTORY ${CMAKE_BINARY_DIR}/proto/gen/ DESTINATION ${include_root} COMPONENT sdk
        FILES_MATCHING PATTERN "*.pb.h")
# The contract itself, for clients in other languages.
install(DIRECTORY ${CMAKE_SOURCE_DIR}/proto/clearance
        DESTINATION ${CMAKE_INSTALL_DATADIR}/clearance/proto COMPONENT sdk FILES_MATCHING PATTERN "*.proto")

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/Clearance)
install(EXPORT ClearanceTargets NAMESPACE Clearance:: DESTINATION ${package_dir} COMPONENT sdk)
install(EXPORT ClearanceMirrorTargets NAMESPACE Clearance:: DESTINATION ${package_dir} COMPONENT sdk)
configure_package_config_file(ClearanceConfig.cmake.in
  ${CMAKE_CURRENT_BINARY_DIR}/ClearanceConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/ClearanceConfigVersion.cmake
  VERSION ${PROJECT_VERSION} COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/ClearanceConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/ClearanceConfigVersion.cmake
        DESTINATION ${package_dir} COMPONENT sdk)
