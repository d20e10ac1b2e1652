# The gateway:   docker build -f deploy/gateway.Dockerfile .
# The building machine decides on package registries: its PIP_* and NPM_CONFIG_* variables are build arguments.

# An exact version, by tag; where you deploy, give one with its digest: --build-arg PYTHON_TAG=…@sha256:…
ARG PYTHON_TAG=3.11.15-slim-bookworm

FROM python:${PYTHON_TAG} AS packages
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /build
COPY deploy/requirements.txt deploy/requirements-build.txt deploy/
# Only packages whose hash is in these files are installed. "make requirements" writes them from pyproject.toml and deploy/constraints.txt.
RUN pip install -q --require-hashes -r deploy/requirements-build.txt \
 && python -m venv --without-pip /opt/linked-fleet \
 && pip --python /opt/linked-fleet/bin/python install -q --require-hashes -r deploy/requirements.txt

# Only the sources of the scripts, so that a change of other files does not bundle them again.
FROM packages AS scripts
COPY gateway/linked_fleet_gateway/extensions /extensions
RUN find /extensions -type f -not -path '*/scripts/*' -delete && find /extensions -type d -empty -delete

# The scripts and styles of the pages; Node.js is not in the image that runs.
FROM packages AS pages
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ARG NPM_CONFIG_REGISTRY
ENV NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt NPM_CONFIG_CAFILE=/etc/ssl/certs/ca-certificates.crt
COPY deploy/requirements-pages.txt deploy/
RUN pip install -q --require-hashes -r deploy/requirements-pages.txt
COPY --from=scripts /extensions gateway/linked_fleet_gateway/extensions
RUN gateway/linked_fleet_gateway/extensions/pages/scripts/build "$(command -v python)"

FROM packages AS built
COPY pyproject.toml README.md LICENSE ./
COPY agents agents
COPY client client
COPY gateway gateway
COPY shapes shapes
COPY --from=pages /build/gateway/linked_fleet_gateway/extensions/pages/assets gateway/linked_fleet_gateway/extensions/pages/assets
COPY deploy/bill_of_materials.py deploy/
RUN --mount=from=pages,source=/build/gateway/linked_fleet_gateway/extensions/pages/scripts/node_modules,target=/build/gateway/linked_fleet_gateway/extensions/pages/scripts/node_modules \
    pip wheel -q --no-index --no-deps --no-build-isolation -w /build/wheels ./agents . \
 && pip --python /opt/linked-fleet/bin/python install -q --no-index --no-deps /build/wheels/*.whl \
 && /opt/linked-fleet/bin/python deploy/bill_of_materials.py /opt/doc gateway/linked_fleet_gateway/extensions/pages/scripts

FROM python:${PYTHON_TAG} AS gateway
LABEL org.opencontainers.image.title="Linked Fleet gateway" \
      org.opencontainers.image.version="0.1.0" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.source="https://w3id.org/linked-fleet"
ENV PATH=/opt/linked-fleet/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    LINKED_FLEET_STATE_DIR=/var/lib/linked-fleet
# Pinocchio is linked with OpenMP.
RUN apt-get update -qq && apt-get install -qqy --no-install-recommends libgomp1 >/dev/null && rm -rf /var/lib/apt/lists/* \
 && install -d -o 10001 -g 10001 /var/lib/linked-fleet
COPY deploy/gateway_health.py /usr/local/lib/linked-fleet/gateway_health.py
COPY --from=built /opt/doc /usr/share/doc/linked-fleet
COPY --from=built /opt/linked-fleet /opt/linked-fleet
USER 10001:10001
WORKDIR /tmp
EXPOSE 8000
HEALTHCHECK --interval=5s --timeout=5s --start-period=30s CMD ["python", "/usr/local/lib/linked-fleet/gateway_health.py"]
ENTRYPOINT ["python", "-P", "-m", "linked_fleet_gateway"]
