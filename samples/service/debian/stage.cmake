# Puts the example configuration where dpkg treats it as the administrator's file. COPY: INSTALL would add DESTDIR.
file(COPY ${CPACK_TACHO_CONFIG} DESTINATION ${CPACK_TEMPORARY_DIRECTORY}/etc/tachograph)
