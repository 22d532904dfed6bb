# Installs the SDK into a folder, builds a project against it and runs it without a server.
# cmake -D BUILD=... -D SOURCE=... -D WORK=... -P package_test.cmake
function(run expected)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT result EQUAL expected)
    message(FATAL_ERROR "${ARGN}\nended with ${result}, expected ${expected}:\n${out}")
  endif()
endfunction()
file(REMOVE_RECURSE ${WORK})
run(0 ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix --component sdk)
run(0 ${CMAKE_COMMAND} -S ${SOURCE} -B ${WORK}/build -G Ninja -DCMAKE_BUILD_TYPE=Release
    -DCMAKE_PREFIX_PATH=${WORK}/prefix)
run(0 ${CMAKE_COMMAND} --build ${WORK}/build)
run(5 ${WORK}/build/uses_clearance 127.0.0.1:1)
run(5 ${WORK}/build/uses_mirror 127.0.0.1:1)
file(REMOVE_RECURSE ${WORK})
