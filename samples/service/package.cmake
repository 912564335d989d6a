# `cpack` in the build folder makes tachograph_VERSION_ARCH.deb: programs, extension, unit, user, example configuration.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME tachograph)
set(CPACK_PACKAGE_CONTACT "The Tachograph authors")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGE_DESCRIPTION
"tacho-recorder polls the robots of a site over their status port and Modbus and keeps every answer byte for byte;
tacho-analyzer answers questions from that log alone. The recorder runs as an unprivileged systemd service, which is
installed but neither enabled nor started: it needs the addresses of your robots in /etc/tachograph/site.toml.")
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION misc)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "adduser | systemd, tzdata")
set(debian ${CMAKE_CURRENT_LIST_DIR}/debian)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${debian}/conffiles ${debian}/postinst ${debian}/prerm ${debian}/postrm)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
# Not with install(): `cmake --install` must never overwrite the configuration of a site.
set(CPACK_PRE_BUILD_SCRIPTS ${debian}/stage.cmake)
set(CPACK_TACHO_CONFIG ${CMAKE_SOURCE_DIR}/samples/config/site.toml)
include(CPack)
